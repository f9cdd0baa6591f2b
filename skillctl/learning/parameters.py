"""From the learner's parameters to a skill in the user's units, and from a mixture to parameters."""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import FitError
from skillctl.learning.blocks import Sizes
from skillctl.learning.em import VELOCITY_FLOOR, JointMixture
from skillctl.learning.field import Field, gate_precisions, most_convex_gate, spread_root
from skillctl.learning.preprocess import TrainingData
from skillctl.model.mixture import GaussianMixture, quadratic_coefficients, quadratic_features, softmax
from skillctl.model.seds import SedsSkill
from skillctl.model.space import Space

SMALLEST_LOG_PRIOR = -600.0  # exp of it is still a normal float64 after normalisation
GAUGES = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # curvatures tried, in inverse squared spreads of the data


def field_of(mixture: JointMixture, blocks: Sizes = ()) -> Field:
    """Return the field whose gates are the mixture's responsibilities of the position."""
    d = mixture.means.shape[1]
    _, log_determinants = np.linalg.slogdet(2 * np.pi * mixture.covariances)
    precisions = np.asarray(np.linalg.inv(mixture.covariances), dtype=np.float64)
    offsets = np.log(mixture.priors) - 0.5 * log_determinants
    logits = quadratic_coefficients(offsets, mixture.means, precisions, np.zeros(d))
    return Field(mixture.matrices, logits, blocks)


def gate_mixture(logits: FloatArray, positions: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return priors, means and covariances whose responsibilities are softmax(W φ).

    Logits are quadratics c + lᵀξ − ½ ξᵀQξ whose Q need not be positive definite. Adding one common
    quadratic −½ (ξ − m)ᵀ G (ξ − m) to all of them changes no weight. G is a multiple of the inverse
    covariance of the data, large enough to make every Q + G positive definite, and m the data's mean; of
    several multiples the one whose priors differ least is taken (ours).

    Args:
        logits: W, shape (K, F).
        positions: The data, shape (N, d); it fixes G and m.

    Raises:
        FitError: Some prior would underflow whatever the gauge.
    """
    d = positions.shape[1]
    quadratic = gate_precisions(logits, d)
    centre = positions.mean(axis=0)
    root = spread_root(positions)
    gauge = np.linalg.inv(root @ root.T)
    base = max(most_convex_gate(logits, root), 0.0)
    best: tuple[FloatArray, FloatArray, FloatArray] | None = None
    spread = -SMALLEST_LOG_PRIOR
    for extra in GAUGES:
        strength = base * 1.1 + extra
        precisions = quadratic + strength * gauge
        precisions = 0.5 * (precisions + precisions.swapaxes(1, 2))
        linear = logits[:, 1 : 1 + d] + strength * gauge @ centre
        covariances = np.linalg.inv(precisions)
        covariances = 0.5 * (covariances + covariances.swapaxes(1, 2))
        means = np.einsum("kij,kj->ki", covariances, linear)
        # Completing the square: log π = c + ½ lᵀΣl + ½ log det Σ, up to a constant common to all.
        logs = logits[:, 0] + 0.5 * np.einsum("ki,ki->k", means, linear)
        logs = logs + 0.5 * np.linalg.slogdet(covariances)[1]
        if np.ptp(logs) < spread:
            spread = float(np.ptp(logs))
            best = softmax(logs.copy()), means, covariances
    if best is None:
        raise FitError(
            "the gates of this fit cannot be written as a Gaussian mixture: some priors underflow.",
            hint="Use fewer components.",
        )
    return best


def skill_of(
    field: Field,
    density: tuple[FloatArray, FloatArray, FloatArray],
    data: TrainingData,
    lyapunov: FloatArray,
    space: Space,
) -> SedsSkill:
    """Return the skill in the user's units.

    Args:
        field: Parameters in the learner's units.
        density: Priors, means, covariances of the position density (of states), in the learner's units.
        data: The training data, for its units, its attractor and the residual covariances.
        lyapunov: P, shape (d, d); a change of the unit of length only scales V, so that P stays valid.
        space: What the state means.
    """
    positions, velocities = data.points
    priors, means, covariances = gate_mixture(field.logits, positions)
    gates = softmax(field.logits @ quadratic_features(positions.T)).T
    residuals = velocities[:, None] - np.einsum("kij,nj->nki", field.matrices, positions)
    weighted = gates / (gates.sum(axis=0) + 1e-9)
    scatter = np.einsum("nk,nki,nkj->kij", weighted, residuals, residuals)
    scatter = 0.5 * (scatter + scatter.swapaxes(1, 2)) + VELOCITY_FLOOR * np.eye(data.dimension)
    length, speed = data.length_scale, data.speed_scale
    anchor = space.anchor(data.attractor)
    return SedsSkill(
        priors=priors,
        means=length * means + anchor,
        covariances=length**2 * covariances,
        system_matrices=field.matrices * (speed / length),
        residual_covariances=speed**2 * scatter,
        attractor=data.attractor,
        lyapunov=lyapunov,
        density=GaussianMixture(density[0], length * density[1] + anchor, length**2 * density[2]),
        space=space,
        coordinates=data.coordinates.in_unit(length),
    )
