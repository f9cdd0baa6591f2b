"""How good a skill is: errors on demonstrations, learned from or left out, regions, comparisons."""
