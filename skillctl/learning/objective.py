"""The objective: velocity errors, distances between rollouts and demonstrations, and a ridge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray, IntArray
from skillctl.geometry import phases
from skillctl.learning.augmentation import displaced_paths, distant_samples
from skillctl.learning.field import Field, heun_rollouts, most_convex_gate, spread_root
from skillctl.learning.moments import VelocityMoments
from skillctl.learning.preprocess import TrainingData
from skillctl.learning.representatives import representatives
from skillctl.learning.sensitivity import RolloutSlopes

# A gate this convex (in the data's own spread) needs a common quadratic of the same size added to all gates
# (see ``gate_mixture``), which shifts log priors by about half of it times the squared spread, up to 9.
MOST_CONVEX = 80.0

MOST_ROLLED = 30  # demonstrations that are rolled out; the velocities of all count
NODES = 8  # times at which rollouts count in the Gauss–Newton matrix; tuned on the 30 LASA motions


@dataclass(frozen=True, eq=False, slots=True)
class Weights:
    """How residuals count against each other; the defaults were tuned on the 30 LASA motions.

    Attributes:
        rollout: Weight of squared rollout distances against squared velocity errors, both mean.
        phase: Cost of matching points one whole path apart, in rms distances.
        robust: Distance below which a rollout residual counts quadratically, above linearly.
        overrun: Length of a rollout, in durations of its demonstration.
        displacement: How far beside the recorded starts displaced paths start, in rms distances.
        displaced_share: Share of the rollout weight that the displaced paths have.
        distances: How far beside the recorded starts the distant samples start, in rms distances; only their
            velocities count.
        distant_weight: Weight of these velocity errors against those on the demonstrations, both mean.
        ridge: Weight of the squared Frobenius norm of each A_k, which keeps the field slow.
    """

    rollout: float = 100.0
    phase: float = 1.0
    robust: float = 0.05
    overrun: float = 1.1
    displacement: float = 0.07
    displaced_share: float = 0.5
    distances: tuple[float, ...] = (0.5, 1.0)
    distant_weight: float = 0.05
    ridge: float = 1e-4


DEFAULT_WEIGHTS = Weights()


@dataclass(frozen=True, eq=False, slots=True)
class Matching:
    """Rollouts, and which of their states each rollout residual depends on.

    Attributes:
        states: Heun states, shape (count + 1, d, D); with time and demonstration flattened, "the table".
        predicted: Heun's predicted states, likewise.
        rows: The two table rows a residual interpolates between, shape (2, M).
        shares: The share of the second row, shape (M,).
        errors: Position differences, each times its W, shape (M, d).
        factors: W of each residual, shape (M, d, d), or None for the identity.
        scales: Square root of the weight of each difference, shape (M,).
        cost: ½ Σ ρ(‖error‖) with the pseudo-Huber ρ.
    """

    states: FloatArray
    predicted: FloatArray
    rows: IntArray
    shares: FloatArray
    errors: FloatArray
    factors: FloatArray | None
    scales: FloatArray
    cost: float


@dataclass(frozen=True, eq=False, slots=True)
class Evaluation:
    """The cost at one field, and the errors it is made of: velocity errors (d, n), and a matching."""

    field: Field
    cost: float
    velocity_errors: FloatArray
    matching: Matching | None


class LearningObjective:
    """½‖r‖² of velocity residuals and, if wanted, rollout residuals with their matching.

    Every demonstration, or ``MOST_ROLLED`` that stand for all, is matched both ways: each of its points
    to the nearest place on the rollout from its start, each rollout state to the nearest place on the
    demonstration, where places a share of the path apart cost extra (``phase``). The matching is redone
    at every evaluation and held fixed inside the Jacobian.

    With rollouts, two terms determine the field where there are no data: velocities on copies far beside the
    demonstrations, and a ridge on A_k, negligible at the speed of the motion. Without them components
    contract up to a hundred times faster than the motion, as fast as the barrier lets them.
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
        y = data.moved
        chosen, shares = representatives(y.positions, MOST_ROLLED)
        self.paths, path_weights = displaced_paths(
            y.positions[chosen], weights.displacement, weights.displaced_share
        )
        copies = len(self.paths) // len(chosen)
        self.path_weights = path_weights * len(chosen) * np.tile(shares, copies)
        self.path_factors = data.factors(self.paths)
        self.steps = np.tile(data.steps[chosen], copies) / substeps
        self.root = spread_root(y.points[0])
        near, distant = y.points, distant_samples(y, weights.distances if rollouts else ())
        positions, targets = (np.vstack(pair) for pair in zip(near, distant, strict=True))
        counts = len(near[0]), len(distant[0])
        point_weights = np.repeat([1 / counts[0], weights.distant_weight / max(counts[1], 1)], counts)
        factors = data.factors(positions)
        metric = None if factors is None else factors.swapaxes(1, 2) @ factors
        self.targets = targets.T.copy()
        self.moments = VelocityMoments(positions.T.copy(), point_weights, metric)
        self.ridge = weights.ridge if rollouts else 0.0
        self.count = substeps * int(np.ceil(weights.overrun * (data.positions.shape[1] - 1)))
        self.path_phase = phases(self.paths)
        self.every = max(1, round(self.count / NODES))

    def representable(self, field: Field) -> bool:
        """Return whether the gates can be stored as a Gaussian mixture without priors that underflow."""
        return most_convex_gate(field.logits, self.root) < MOST_CONVEX

    def evaluate(self, field: Field) -> Evaluation:
        """Return the cost and the errors at ``field``."""
        moments = self.moments
        errors = field.velocities(moments.positions, moments.features) - self.targets
        cost = float((errors * moments.weighed(errors)).sum()) + self.ridge * float((field.matrices**2).sum())
        if not self.rollouts:
            return Evaluation(field, 0.5 * cost, errors, None)
        states, predicted = heun_rollouts(field, self.paths[:, 0].T, self.steps, self.count)
        if not np.isfinite(states).all():  # the steps are too long for so fast a field
            return Evaluation(field, np.inf, errors, None)
        matching = self._matched(states, predicted)
        return Evaluation(field, 0.5 * cost + matching.cost, errors, matching)

    def normal_equations(self, evaluation: Evaluation) -> tuple[FloatArray, FloatArray]:
        """Return the Gauss–Newton matrix and the gradient of the cost at fixed matching, (p, p) and (p,).

        The gradient is exact. In the matrix, rollouts count at ``NODES`` times only.
        """
        field, matching, moments = evaluation.field, evaluation.matching, self.moments
        at = moments.linearised(field)
        normal, slope = moments.normal(at), at.pull_back(moments.weighed(evaluation.velocity_errors))
        entries = np.arange(field.entries.size)
        normal[entries, entries] += self.ridge
        slope[entries] += self.ridge * field.entries.ravel()
        if matching is not None:
            pulls, weights = _gathered(matching)
            slopes = RolloutSlopes(field, matching.states, matching.predicted, self.steps)
            slope += slopes.gradient(pulls)
            rows = _weighted(slopes.at_nodes(self.every), weights, self.every)
            normal += rows.T @ rows
        return normal, slope

    def _matched(self, states: FloatArray, predicted: FloatArray) -> Matching:
        """Match the rollouts from every demonstration's start with the demonstration, both ways."""
        demos, rolled = self.paths, states.transpose(2, 0, 1)
        trajectories, length, d = rolled.shape
        samples = demos.shape[1]
        rolled_phase, phase = phases(rolled), self.weights.phase
        column = np.arange(trajectories)[:, None]  # row ``time · trajectories + column`` of the table
        index, share = _nearest_place(demos, self.path_phase, rolled, rolled_phase, phase)
        to_rollout = _at(rolled, index, share) - demos
        demo_index, fraction = _nearest_place(rolled, rolled_phase, demos, self.path_phase, phase)
        to_demo = rolled - _at(demos, demo_index, fraction)
        own = np.arange(length) * trajectories + column
        first = index * trajectories + column
        rows = np.stack([np.hstack([first, own]), np.hstack([first + trajectories, own])])
        shares = np.hstack([share, np.zeros(own.shape)]).ravel()
        errors = np.concatenate([to_rollout, to_demo], axis=1).reshape(-1, d)
        factors = None
        if self.path_factors is not None:
            compared = self.path_factors[column, np.rint(demo_index + fraction).astype(np.int64)]
            factors = np.concatenate([self.path_factors, compared], axis=1).reshape(-1, d, d)
        errors = _times(factors, errors)
        shares_of_points = np.repeat([1 / samples, 1 / length], [samples, length])
        weights = 0.5 * self.weights.rollout * np.outer(self.path_weights, shares_of_points).ravel()
        # Pseudo-Huber: ρ(r) = 2 δ² (√(1 + r²/δ²) − 1), quadratic below δ and linear above. Iteratively
        # reweighted least squares: scaled by √(w ρ'(r)/2r) = √(w/√(…)), the residuals have ρ's gradient.
        root = np.sqrt(1.0 + (errors**2).sum(axis=1) / self.weights.robust**2)
        cost = float(weights @ (root - 1.0)) * self.weights.robust**2
        scales = np.sqrt(weights / root)
        return Matching(states, predicted, rows.reshape(2, -1), shares, errors, factors, scales, cost)


def reproduction_error(data: TrainingData, field: Field) -> float:
    """Return the robust mean square distance of the demonstrations from motions that start where they do.

    Infinite where rollouts explode.
    """
    matching = LearningObjective(data, Weights(displacement=0.0), substeps=2).evaluate(field).matching
    return np.inf if matching is None else matching.cost


def _gathered(matching: Matching) -> tuple[FloatArray, FloatArray]:
    """Return the gradient of the cost by each state of the rollouts, and how much each state counts.

    A residual between two states, with shares 1 − t and t, counts at each in proportion to its share. For the
    Gauss–Newton matrix that is an upper bound, and a close one as the states are one step apart.

    Returns:
        Shapes (count + 1, D, d) and (count + 1, D, 1, 1), or (count + 1, D, d, d) if residuals have a W.
    """
    first, second = matching.rows
    length, d, trajectories = matching.states.shape
    share, weight = matching.shares[:, None], matching.scales[:, None] ** 2
    metric, pulls = np.ones((len(weight), 1)), weight * matching.errors
    if matching.factors is not None:
        transposed = matching.factors.swapaxes(1, 2)
        metric, pulls = (transposed @ matching.factors).reshape(-1, d * d), _times(transposed, pulls)

    def summed(values: FloatArray) -> FloatArray:
        columns = [
            np.bincount(first, before, length * trajectories)
            + np.bincount(second, after, length * trajectories)
            for before, after in zip(((1 - share) * values).T, (share * values).T, strict=True)
        ]
        return np.stack(columns, axis=1).reshape(length, trajectories, -1)

    weights = summed(weight * metric)
    side = int(np.sqrt(weights.shape[2]))
    return summed(pulls), weights.reshape(length, trajectories, side, side)


def _weighted(table: FloatArray, weights: FloatArray, every: int) -> FloatArray:
    """Return rows R with RᵀR = Σ Sᵀ weight S over all states, from the sensitivities S (nodes, D, d, p).

    The weight of a state between two nodes is shared by these. The start, whose S is zero, counts as a node.
    """
    nodes, _, d, p = table.shape
    before = np.arange(1 - len(weights), 1) / every + nodes  # place of each state, in nodes from the start
    hats = np.maximum(0.0, 1.0 - np.abs(before - np.arange(1, nodes + 1)[:, None]))
    weights = np.tensordot(hats, weights, 1)
    if weights.shape[2:] == (1, 1):
        return np.asarray((np.sqrt(weights) * table).reshape(-1, p))
    floor = 1e-12 * np.trace(weights, axis1=2, axis2=3)[..., None, None] * np.eye(d)
    roots = np.linalg.cholesky(weights + floor)
    return np.asarray((roots.swapaxes(2, 3) @ table).reshape(-1, p))


def _times(factors: FloatArray | None, errors: FloatArray) -> FloatArray:
    """Return W e for errors (n, d) and factors W (n, d, d), or None for the identity."""
    return errors if factors is None else np.asarray((factors @ errors[..., None])[..., 0])


def _at(paths: FloatArray, index: IntArray, share: FloatArray) -> FloatArray:
    """Return the points a share along the given segments of paths (D, S, d). Shape (D, T, d)."""
    path = np.arange(len(paths))[:, None]
    return np.asarray((1 - share)[..., None] * paths[path, index] + share[..., None] * paths[path, index + 1])


def _nearest_place(
    points: FloatArray, point_phase: FloatArray, path: FloatArray, path_phase: FloatArray, phase_cost: float
) -> tuple[IntArray, FloatArray]:
    """Return, for each point, the segment of the path nearest to it and how far along that segment.

    points (D, T, d), path (D, S, d); index (D, T) in 0 … S − 2 and share (D, T) in [0, 1].
    """
    # With the phase as one more coordinate, a difference in phase is part of the distance.
    a = np.concatenate([points, phase_cost * point_phase[..., None]], axis=2)
    b = np.concatenate([path, phase_cost * path_phase[..., None]], axis=2)
    squared = np.einsum("...i,...i", b, b)[:, None] - 2.0 * a @ b.swapaxes(1, 2)
    nearest = squared.argmin(axis=2)
    last = path.shape[1] - 2
    # The nearest vertex has a segment on either side: the nearer one of the two is taken.
    segments = np.stack([np.clip(nearest - 1, 0, last), np.clip(nearest, 0, last)])
    row = np.arange(len(points))[:, None]
    origins = b[row, segments]
    steps = b[row, segments + 1] - origins
    lengths = np.maximum(np.einsum("...i,...i", steps, steps), 1e-24)
    shares = np.clip(np.einsum("...i,...i", a - origins, steps) / lengths, 0.0, 1.0)
    offsets = origins + shares[..., None] * steps - a
    distances = np.einsum("...i,...i", offsets, offsets)
    later = distances[1] < distances[0]
    return np.where(later, segments[1], segments[0]), np.where(later, shares[1], shares[0])
