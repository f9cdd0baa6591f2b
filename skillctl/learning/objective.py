"""What is minimised: velocity errors, and distances between rollouts and demonstrations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.learning.field import Field, heun_rollouts, rollout_sensitivities
from skillctl.learning.preprocess import TrainingData


@dataclass(frozen=True, eq=False, slots=True)
class Weights:
    """How residuals count against each other.

    Attributes:
        rollout: Weight of squared rollout distances against squared velocity errors, both mean.
        phase: Cost of matching points one whole path apart, in rms distances.
        robust: Distance below which a rollout residual counts quadratically, above linearly.
        overrun: Length of a rollout, in durations of its demonstration.
    """

    rollout: float = 10.0
    phase: float = 1.0
    robust: float = 0.05
    overrun: float = 1.1


DEFAULT_WEIGHTS = Weights()


@dataclass(frozen=True, eq=False, slots=True)
class Matching:
    """Rollouts, and which of their states each rollout residual depends on.

    Attributes:
        states: Heun states, shape (count + 1, d, D); with time and demonstration flattened, "the table".
        predicted: Heun's predicted states, likewise.
        rows: The two table rows a residual interpolates between, shape (2, M).
        shares: The share of the second row, shape (M,).
        errors: Position differences, shape (M, d).
        scales: Square root of the weight of each difference, shape (M,).
        cost: ½ Σ ρ(‖error‖) with the pseudo-Huber ρ.
    """

    states: FloatArray
    predicted: FloatArray
    rows: IntArray
    shares: FloatArray
    errors: FloatArray
    scales: FloatArray
    cost: float


@dataclass(frozen=True, eq=False, slots=True)
class Evaluation:
    """Residuals at one field. Jᵀ residuals is the gradient of the cost for a fixed matching.

    The cost is robust, so it is not ½‖residuals‖².
    """

    field: Field
    cost: float
    residuals: FloatArray
    matching: Matching | None


class LearningObjective:
    """½‖r‖² of velocity residuals and, if wanted, rollout residuals with their matching.

    Every demonstration is matched both ways: each of its points to the nearest place on the rollout
    from its start, each rollout state to the nearest place on the demonstration, where places a share
    of the path apart cost extra (``phase``). The matching is redone at every evaluation and held fixed
    inside the Jacobian.
    """

    def __init__(
        self,
        data: TrainingData,
        weights: Weights = DEFAULT_WEIGHTS,
        *,
        rollouts: bool = True,
        substeps: int = 1,
    ) -> None:
        """Args: data; weights; rollouts: count them; substeps: integration steps per sample."""
        self.data, self.weights, self.rollouts = data, weights, rollouts
        self.steps = data.steps / substeps
        self.positions, self.targets = (a.T.copy() for a in data.points)
        self.velocity_weight = 1.0 / np.sqrt(self.positions.shape[1])
        self.count = substeps * int(np.ceil(weights.overrun * (data.positions.shape[1] - 1)))
        self.demo_phase = _phases(data.positions)

    def evaluate(self, field: Field) -> Evaluation:
        """Return the residuals at ``field``."""
        velocity = (self.velocity_weight * (field.velocities(self.positions) - self.targets)).T.ravel()
        cost = 0.5 * float(velocity @ velocity)
        if not self.rollouts:
            return Evaluation(field, cost, velocity, None)
        matching = self._matched(field)
        rollout = (matching.scales[:, None] * matching.errors).ravel()
        return Evaluation(field, cost + matching.cost, np.append(velocity, rollout), matching)

    def jacobian(self, evaluation: Evaluation) -> FloatArray:
        """Return ∂residual/∂θ with the matching held fixed. Shape (residuals, parameters)."""
        field, matching = evaluation.field, evaluation.matching
        p = field.n_parameters
        velocity = np.asarray(self.velocity_weight * field.linearised(self.positions)[2].reshape(-1, p))
        if matching is None:
            return velocity
        table = rollout_sensitivities(field, matching.states, matching.predicted, self.steps)
        table = table.reshape(-1, self.data.dimension, p)
        first, second = matching.rows
        own = (matching.scales * (1 - matching.shares))[:, None, None]
        next_ = (matching.scales * matching.shares)[:, None, None]
        rollout = own * table[first] + next_ * table[second]
        return np.concatenate([velocity, rollout.reshape(-1, p)])

    def _matched(self, field: Field) -> Matching:
        """Roll out from every demonstration's start and match both ways."""
        demos = self.data.positions
        states, predicted = heun_rollouts(field, demos[:, 0].T, self.steps, self.count)
        paths = states.transpose(2, 0, 1)
        trajectories, length, d = paths.shape
        samples = demos.shape[1]
        path_phase, phase = _phases(paths), self.weights.phase
        who = np.arange(trajectories)[:, None]
        index, share = _nearest_place(demos, self.demo_phase, paths, path_phase, phase)
        to_rollout = _at(paths, index, share) - demos
        demo_index, fraction = _nearest_place(paths, path_phase, demos, self.demo_phase, phase)
        to_demo = paths - _at(demos, demo_index, fraction)
        own = np.arange(length) * trajectories + who
        rows = np.stack(
            [np.hstack([index * trajectories + who, own]), np.hstack([(index + 1) * trajectories + who, own])]
        )
        shares = np.hstack([share, np.zeros(own.shape)]).ravel()
        errors = np.concatenate([to_rollout, to_demo], axis=1).reshape(-1, d)
        counts = np.tile(np.repeat([samples, length], [samples, length]), trajectories) * trajectories
        weights = 0.5 * self.weights.rollout / counts
        # Pseudo-Huber: ρ(r) = 2 δ² (√(1 + r²/δ²) − 1), quadratic below δ and linear above; ρ'/2r = 1/√(…)
        root = np.sqrt(1.0 + (errors**2).sum(axis=1) / self.weights.robust**2)
        cost = float(weights @ (root - 1.0)) * self.weights.robust**2
        scales = np.sqrt(weights / root)
        return Matching(states, predicted, rows.reshape(2, -1), shares, errors, scales, cost)


def _phases(paths: FloatArray) -> FloatArray:
    """Return the share of the path length covered at each point of paths (D, T, d). Shape (D, T)."""
    lengths = np.linalg.norm(np.diff(paths, axis=1), axis=2)
    covered = np.concatenate([np.zeros((len(paths), 1)), np.cumsum(lengths, axis=1)], axis=1)
    return np.asarray(covered / np.maximum(covered[:, -1:], 1e-12))


def _at(paths: FloatArray, index: IntArray, share: FloatArray) -> FloatArray:
    """Return the points a share along the given segments of paths (D, S, d). Shape (D, T, d)."""
    who = np.arange(len(paths))[:, None]
    return np.asarray((1 - share)[..., None] * paths[who, index] + share[..., None] * paths[who, index + 1])


def _nearest_place(
    points: FloatArray, point_phase: FloatArray, path: FloatArray, path_phase: FloatArray, phase_cost: float
) -> tuple[IntArray, FloatArray]:
    """Return, for each point, the segment of the path nearest to it and how far along that segment.

    points (D, T, d), path (D, S, d); index (D, T) in 0 … S − 2 and share (D, T) in [0, 1].
    """
    a = np.concatenate([points, phase_cost * point_phase[..., None]], axis=2)
    b = np.concatenate([path, phase_cost * path_phase[..., None]], axis=2)
    squared = (b * b).sum(axis=2)[:, None] - 2.0 * a @ b.swapaxes(1, 2)
    nearest = squared.argmin(axis=2)
    last = path.shape[1] - 2
    before, after = np.clip(nearest - 1, 0, last), np.clip(nearest, 0, last)
    share_before, distance_before = _project(a, b, before)
    share_after, distance_after = _project(a, b, after)
    later = distance_after < distance_before
    return np.where(later, after, before), np.where(later, share_after, share_before)


def _project(points: FloatArray, path: FloatArray, index: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return share along, and squared distance to, the given segment for each point. Both (D, T)."""
    who = np.arange(len(points))[:, None]
    origin = path[who, index]
    step = path[who, index + 1] - origin
    share = ((points - origin) * step).sum(axis=2) / np.maximum((step * step).sum(axis=2), 1e-24)
    share = np.clip(share, 0.0, 1.0)
    return share, np.asarray(((origin + share[..., None] * step - points) ** 2).sum(axis=2))
