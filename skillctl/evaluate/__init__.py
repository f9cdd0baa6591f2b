"""How good a skill is: errors on demonstrations, shown and left out, regions, comparisons."""
