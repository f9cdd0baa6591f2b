"""Skills from skills."""
