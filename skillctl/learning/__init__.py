"""How a skill is learned."""
