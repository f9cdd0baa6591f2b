"""Coordinates y = c(s) of a state s: exactly invertible maps in front of the mixture."""
