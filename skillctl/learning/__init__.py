"""How a skill is learned from demonstrations (Section 2)."""
