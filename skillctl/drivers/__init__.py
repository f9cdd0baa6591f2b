"""Robots that a skill is run on: the loop that gives commands, and a driver for each kind of robot."""
