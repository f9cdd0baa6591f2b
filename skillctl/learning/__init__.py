"""How a skill is learned from demonstrations (Section 2)."""

from skillctl.learning.fit import Fit, fit, learned_metric
from skillctl.learning.options import METRICS, OBJECTIVES, PRESETS, LearnOptions
from skillctl.learning.solve import Progress

__all__ = ["METRICS", "OBJECTIVES", "PRESETS", "Fit", "LearnOptions", "Progress", "fit", "learned_metric"]
