"""What a skill is: space, coordinates, mixture, skill tree, stepping. NumPy only, no files."""
