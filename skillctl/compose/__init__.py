"""Skills made from skills: merge, combine, and the common Lyapunov matrix that proves a merger."""

from skillctl.compose.adapt import Adaptation, adapt, most_helpful, scaled_components
from skillctl.compose.combine import combine
from skillctl.compose.coverage import PartCoverage, calibrated_priors, coverage, selected_shares
from skillctl.compose.lyapunov import (
    acting_matrices,
    common_lyapunov,
    common_lyapunov_of,
    conflicting_parts,
    with_lyapunov,
)
from skillctl.compose.merge import NoCommonLyapunovError, merge
from skillctl.compose.parts import notes_on

__all__ = [
    "Adaptation",
    "NoCommonLyapunovError",
    "PartCoverage",
    "acting_matrices",
    "adapt",
    "calibrated_priors",
    "combine",
    "common_lyapunov",
    "common_lyapunov_of",
    "conflicting_parts",
    "coverage",
    "merge",
    "most_helpful",
    "notes_on",
    "scaled_components",
    "selected_shares",
    "with_lyapunov",
]
