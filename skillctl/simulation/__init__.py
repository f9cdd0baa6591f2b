"""A skill on an arm."""
