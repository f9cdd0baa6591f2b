"""What a fit will take, before it is begun: memory and time, from the sizes of its arrays and products."""

from __future__ import annotations

from math import ceil, comb

from skillctl.errors import ResourceError
from skillctl.learning.objective import DEFAULT_WEIGHTS, MOST_ROLLED, NODES
from skillctl.learning.options import LearnOptions
from skillctl.memory import require

LONGEST = 24 * 3600.0  # [s]: a fit that is estimated to take longer is refused
RATE = 5e9  # products and sums a second of one core, in the large matrices that decide; measured
HINT = "Use fewer --components, columns (--columns) or demonstrations (--demos), or --preset fast."


def memory_of(d: int, k: int, demonstrations: int, options: LearnOptions) -> float:
    """Return about the memory that a fit takes at its largest, [bytes].

    Args:
        d: Dimensions of the state.
        k: Components.
        demonstrations: How many there are.
        options: How it is learned.
    """
    size = _Sizes(d, k, demonstrations, options)
    numbers = 8.0 * k * d**4  # the curvature of the barrier at each A_k, of EM, and temporaries
    if options.objective != "likelihood":
        numbers += 6.0 * size.features**2 * (d + 1) + 3.0 * size.monomials * size.points
        numbers += 4.0 * size.parameters**2  # the normal matrix, damped, and in the solver
    if options.objective == "reproduction":
        numbers += 3.0 * size.sensitivities * size.parameters
        numbers += 2.0 * size.rolled * (2 * k * d + size.features + 3 * d * d)
    return 8.0 * numbers


def seconds_of(d: int, k: int, demonstrations: int, options: LearnOptions) -> float:
    """Return about the CPU time of a fit, [s], of which it does not take less than some seconds."""
    size, effort = _Sizes(d, k, demonstrations, options), options.effort
    regression = 60.0 * k * d**6  # Newton's method for the A_k of each component
    if options.objective == "likelihood":
        return 200.0 * regression / RATE
    p = size.parameters
    step = 2.0 * p**3 + 4.0 * d * p**2 + k * (k + 1) * size.monomials * size.points
    if options.objective == "reproduction":
        step += 2.0 * size.sensitivities * p**2
    steps = effort.starts * effort.probe_steps + 1.5 * effort.polish_steps
    choices = 2 if options.objective == "reproduction" and options.metric == "learned" else 1
    return choices * (effort.starts * 10 * regression + steps * step) / RATE


def require_affordable(d: int, k: int, demonstrations: int, options: LearnOptions) -> float:
    """Return the estimated CPU time of a fit, [s].

    Raises:
        ResourceError: It takes more than ``memory.SHARE`` of the free memory, or longer than ``LONGEST``.
    """
    what = f"a fit of {k} components in {d} dimensions"
    require(memory_of(d, k, demonstrations, options), what, HINT)
    seconds = seconds_of(d, k, demonstrations, options)
    if seconds > LONGEST:
        raise ResourceError(
            f"{what} takes about {seconds / 3600:.0f} hours, and at most {LONGEST / 3600:.0f} are allowed.",
            hint=HINT,
        )
    return seconds


class _Sizes:
    """Numbers of features of the gates, parameters, distinct monomials, points and sensitivities."""

    def __init__(self, d: int, k: int, demonstrations: int, options: LearnOptions) -> None:
        samples = options.effort.samples_of(demonstrations)
        copies = 2 * len(DEFAULT_WEIGHTS.distances) * ceil(d / demonstrations)
        reproduces = options.objective == "reproduction"
        self.features = comb(d + 2, 2)
        self.parameters = k * (d * d + self.features)
        self.monomials = comb(d + 4, 4)
        self.points = demonstrations * samples * (1 + (copies if reproduces else 0))
        trajectories = min(demonstrations, MOST_ROLLED) * (1 + 2 * max(1, d // 2))
        self.sensitivities = NODES * trajectories * d
        self.rolled = 2 * 2 * DEFAULT_WEIGHTS.overrun * samples * trajectories
