"""The gates of merged and combined skills, a record each; choices, help and error texts derive from them.

Importing this module needs no NumPy, so that the command line can name the gates at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from skillctl.errors import UsageError

if TYPE_CHECKING:
    from skillctl.arrays import FloatArray, IntArray

# (h, owners, weights, shares, parameters) -> h̃: h (n, K) holds the weights of all components within their own
# part, owners (K,) the part of each component, weights αᵢ of shape (parts,), or (n, parts) for mergers that
# differ from state to state, and shares() gives αᵢ pᵢ / Σⱼ αⱼ pⱼ, shape (n, parts).
Weighting = Callable[
    ["FloatArray", "IntArray", "FloatArray", Callable[[], "FloatArray"], Mapping[str, float]], "FloatArray"
]


@dataclass(frozen=True, slots=True)
class GateParameter:
    """A number that a gate takes: its name, its default, the least it may be, and what it does."""

    name: str
    default: float
    least: float
    help: str


@dataclass(frozen=True, slots=True)
class MergeGate:
    """How the components of parts that act together are weighted.

    Attributes:
        name: As the user types it.
        help: What it does, in a few words.
        weigh: Weights h̃ ≥ 0 of all components, summing to one; any such weights keep a merged skill stable.
        parameters: Numbers that it takes.
    """

    name: str
    help: str
    weigh: Weighting
    parameters: tuple[GateParameter, ...] = ()


@dataclass(frozen=True, slots=True)
class CombineGate:
    """When the part that acts alone is chosen: ``reselects`` at every instant, else at a start."""

    name: str
    help: str
    reselects: bool


def _superposition(h: Any, owners: Any, weights: Any, shares: Any, parameters: Any) -> Any:
    return weights[..., owners] * h


def _density(h: Any, owners: Any, weights: Any, shares: Any, parameters: Any) -> Any:
    return shares()[..., owners] * h


def _experts(h: Any, owners: Any, weights: Any, shares: Any, parameters: Any) -> Any:
    # Relative to the largest weight, so that no sharpness makes all powers vanish.
    powers = (h / h.max(axis=-1, keepdims=True)) ** parameters["sharpness"]
    powers *= weights[..., owners]
    return powers / powers.sum(axis=-1, keepdims=True)


# With 1 this gate is superposition. On seven pairs of LASA motions 4 gives the stronger part two thirds of
# the motion along the demonstrations instead of a half, 22 % of their extent off (19 with 1, 23 with 16).
SHARPNESS = 4.0

MERGE_GATES = (
    MergeGate("superposition", "all act everywhere", _superposition),  # Eq. 7 and 8
    MergeGate("density", "each mostly where it was taught", _density),  # Eq. 8 read as densities
    MergeGate(  # Eq. 9
        "experts",
        "the strongest Gaussian of a place counts most",
        _experts,
        (GateParameter("sharpness", SHARPNESS, 1.0, "How sharply the strongest Gaussian is preferred"),),
    ),
)
COMBINE_GATES = (
    CombineGate(
        "latched", "the acting skill is chosen at the start, and again after a disturbance", reselects=False
    ),
    CombineGate("instantaneous", "at every instant, without a guarantee unless aligned", reselects=True),
)

Gate = TypeVar("Gate", MergeGate, CombineGate)


def merge_gate(name: str) -> MergeGate:
    """Return the merge gate of a name, or raise UsageError."""
    return _named(name, MERGE_GATES)


def combine_gate(name: str) -> CombineGate:
    """Return the combine gate of a name, or raise UsageError."""
    return _named(name, COMBINE_GATES)


def gate_parameters(gate: MergeGate, given: Mapping[str, float]) -> dict[str, float]:
    """Return all parameters of a gate: those given, else the defaults.

    Raises:
        UsageError: A parameter that the gate does not have, or a value below the least.
    """
    known = {parameter.name: parameter for parameter in gate.parameters}
    for name, value in given.items():
        if name not in known:
            owners = [other.name for other in MERGE_GATES if name in {p.name for p in other.parameters}]
            hint = f"Add --gate {owners[0]}." if owners else ""
            raise UsageError(f"{name}: the {gate.name} gate does not take it.", hint=hint)
        if not known[name].least <= value < float("inf"):  # NaN is not
            raise UsageError(f"{name}: must be at least {known[name].least:g}, got {value:g}.")
    return {name: float(given.get(name, parameter.default)) for name, parameter in known.items()}


def _named(name: str, gates: tuple[Gate, ...]) -> Gate:
    for gate in gates:
        if gate.name == name:
            return gate
    raise UsageError(f"gate: one of {', '.join(gate.name for gate in gates)}, not {name!r}.")
