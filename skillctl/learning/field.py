"""The vector field in the learner's parameters, its derivatives, and its rollouts.

Parameters: system matrices A (K, d, d) and gate logits W (K, F), logit_k(ξ) = W_k · φ(ξ) with the
quadratic features φ = (1, ξ_i, ξ_i ξ_j for i ≤ j). Target at the origin, the learner's units.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.learning.blocks import Sizes, filled, free, spans
from skillctl.model.mixture import quadratic_features, softmax


@dataclass(frozen=True, eq=False, slots=True)
class Field:
    """f(ξ) = Σ_k h_k(ξ) A_k ξ with h = softmax(W φ(ξ)).

    Attributes:
        matrices: A, shape (K, d, d).
        logits: W, shape (K, F).
        blocks: Sizes of the blocks of A whose entries are parameters; default: one block.
    """

    matrices: FloatArray
    logits: FloatArray
    blocks: Sizes = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "blocks", self.blocks or (self.matrices.shape[1],))

    @property
    def entries(self) -> FloatArray:
        """The free entries of A, shape (K, m)."""
        return free(self.matrices, self.blocks)

    @property
    def n_parameters(self) -> int:
        """Number of free entries of A and W together."""
        return self.entries.size + self.logits.size

    def split(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the parts for A (K, d, d) and W (K, F) of a vector (p,): free entries, then W row by row."""
        size = self.entries.size
        entries = parameters[:size].reshape(len(self.matrices), -1)
        return filled(entries, self.blocks), parameters[size:].reshape(self.logits.shape)

    def stepped(self, step: FloatArray) -> Field:
        """Return the field with ``step`` (p,), ordered as in ``split``, added to its parameters."""
        matrices, logits = self.split(step)
        return Field(self.matrices + matrices, self.logits + logits, self.blocks)

    def velocities(self, positions: FloatArray, features: FloatArray | None = None) -> FloatArray:
        """Return f for positions (d, n), in the same shape; ``features``: φ(positions), if it is known."""
        d = len(positions)
        phi = quadratic_features(positions) if features is None else features
        gates = softmax(self.logits @ phi)
        mixed = self.matrices.reshape(len(gates), d * d).T @ gates
        return np.asarray((mixed.reshape(d, d, -1) * positions).sum(axis=1))

    def linearised(self, positions: FloatArray, features: FloatArray | None = None) -> Linearised:
        """Return how f depends on θ at positions (d, n); ``features``: φ(positions), if it is known."""
        d, n = positions.shape
        phi = quadratic_features(positions) if features is None else features
        gates = softmax(self.logits @ phi)
        images = (self.matrices.reshape(-1, d) @ positions).reshape(-1, d, n)
        mean = (gates[:, None] * images).sum(axis=0)
        # ∂h_j/∂logit_k = h_j (δ_jk − h_k), so ∂f/∂logit_k = h_k (A_k ξ − f): the chain rule through softmax.
        return Linearised(positions, phi, gates, gates[:, None] * (images - mean), self.blocks)

    def by_state(self, at: Linearised) -> FloatArray:
        """Return ∂f/∂ξ at n points. Shape (n, d, d)."""
        k, d, n = at.spread.shape
        mixed = at.gates.T @ self.matrices.reshape(k, d * d)
        slopes = _logit_slopes(self.logits, at.positions)
        # A copy in the order of the product makes the product many times faster.
        through_gates = at.spread.transpose(2, 1, 0).copy() @ slopes.transpose(2, 0, 1).copy()
        return np.asarray(mixed.reshape(n, d, d) + through_gates)


@dataclass(frozen=True, eq=False, slots=True)
class Linearised:
    """∂f/∂θ at n points, in factors: ∂f_i/∂A_k,ij = h_k ξ_j, and ∂f/∂W_k = s_k φᵀ.

    Attributes:
        positions: ξ, shape (d, n).
        features: φ, shape (F, n).
        gates: h, shape (K, n).
        spread: s_k = ∂f/∂logit_k = h_k (A_k ξ − f), shape (K, d, n).
        blocks: Sizes of the blocks of A whose entries are parameters.
    """

    positions: FloatArray
    features: FloatArray
    gates: FloatArray
    spread: FloatArray
    blocks: Sizes

    def pull_back(self, forces: FloatArray) -> FloatArray:
        """Return Σ_n (∂f/∂θ)ᵀ force for forces (d, n). Shape (p,), ordered as in ``Field.split``."""
        k, _, n = self.spread.shape
        gated = self.gates[:, None] * forces
        blocks = [gated[:, s].reshape(-1, n) @ self.positions[s].T for s in spans(self.blocks)]
        entries = np.concatenate([block.reshape(k, -1) for block in blocks], axis=1)
        logits = (self.spread * forces).sum(axis=1) @ self.features.T
        return np.concatenate([entries.ravel(), logits.ravel()])


def _logit_slopes(logits: FloatArray, positions: FloatArray) -> FloatArray:
    """Return ∂logit_k/∂ξ_j at positions (d, n). Shape (K, d, n)."""
    d, n = positions.shape
    k = len(logits)
    bend = gate_precisions(logits, d).reshape(k * d, d) @ positions
    return np.asarray(logits[:, 1 : 1 + d, None] - bend.reshape(k, d, n))


def gate_precisions(logits: FloatArray, d: int) -> FloatArray:
    """Return Q_k of logit_k(ξ) = c + lᵀξ − ½ ξᵀQ_kξ for logits W (K, F). Shape (K, d, d), symmetric."""
    rows, columns = np.triu_indices(d)
    quadratic = np.zeros((len(logits), d, d))
    quadratic[:, rows, columns] = -logits[:, 1 + d :]
    # The diagonal doubles: −½ Q_ii is the coefficient of ξ_i², −Q_ij that of ξ_i ξ_j.
    return np.asarray(quadratic + quadratic.swapaxes(1, 2))


def spread_root(positions: FloatArray) -> FloatArray:
    """Return the Cholesky factor of the covariance of the data (N, d), kept away from flat. Shape (d, d)."""
    d = positions.shape[1]
    covariance = np.cov(positions.T).reshape(d, d) + 1e-3 * np.eye(d)
    return np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)


def most_convex_gate(logits: FloatArray, root: FloatArray) -> float:
    """Return how far the most convex gate is from a Gaussian: −λ_min of all Q_k in whitened coordinates.

    Args:
        logits: W, shape (K, F).
        root: Cholesky factor of the covariance of the data, shape (d, d).
    """
    return -float(np.linalg.eigvalsh(root.T @ gate_precisions(logits, len(root)) @ root).min())


def heun_rollouts(
    field: Field, starts: FloatArray, steps: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Integrate from several starts with Heun's method.

    Args:
        field: f.
        starts: Shape (d, D).
        steps: Time step of each trajectory, shape (D,).
        count: Number of steps.

    Returns:
        States and Heun's predicted states, each of shape (count + 1, d, D); the last prediction is unused.
    """
    velocity = _flow(field, starts.shape[1])
    states = np.empty((count + 1, *starts.shape))
    predicted = np.empty_like(states)
    states[0], half = starts, 0.5 * steps
    with np.errstate(over="ignore", invalid="ignore"):  # a rollout that explodes is for the caller to judge
        for x, ahead, after in zip(states, predicted, states[1:], strict=False):
            slope = velocity(x)
            np.multiply(steps, slope, out=ahead)
            ahead += x
            slope += velocity(ahead)
            slope *= half
            np.add(x, slope, out=after)
    predicted[count] = states[count]
    return states, predicted


def _flow(field: Field, n: int) -> Callable[[FloatArray], FloatArray]:
    """Return f for positions (d, n), made for many calls: its intermediate results keep their places."""
    k, d, _ = field.matrices.shape
    features = np.ones((field.logits.shape[1], n))
    ends = np.cumsum([1 + d, *range(d, 0, -1)])
    products = [features[first:last] for first, last in pairwise(ends)]
    gates = np.empty((k, n))
    mixed = np.empty((d * d + 1, n))  # Σ_k g_k A_k and, last, Σ_k g_k for gates g that do not sum to one yet
    matrices = np.vstack([field.matrices.reshape(k, d * d).T, np.ones(k)])

    def velocity(positions: FloatArray) -> FloatArray:
        features[1 : 1 + d] = positions
        for i, product in enumerate(products):
            np.multiply(positions[i], positions[i:], out=product)
        np.matmul(field.logits, features, out=gates)
        np.subtract(gates, np.maximum.reduce(gates, axis=0), out=gates)
        np.exp(gates, out=gates)
        np.matmul(matrices, gates, out=mixed)
        by_entry = mixed[:-1].reshape(d, d, n)
        np.multiply(by_entry, positions, out=by_entry)
        return np.asarray(np.add.reduce(by_entry, axis=1) / mixed[-1])

    return velocity
