"""Skills on disk."""
