"""The vector field in the learner's parameters, its derivatives, and its rollouts with sensitivities.

Parameters: system matrices A (K, d, d) and gate logits W (K, F), logit_k(ξ) = W_k · φ(ξ) with the
quadratic features φ = (1, ξ_i, ξ_i ξ_j for i ≤ j). Target at the origin, the learner's units.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.model.mixture import quadratic_features, softmax


@dataclass(frozen=True, eq=False, slots=True)
class Field:
    """f(ξ) = Σ_k h_k(ξ) A_k ξ with h = softmax(W φ(ξ)).

    Attributes:
        matrices: A, shape (K, d, d).
        logits: W, shape (K, F).
    """

    matrices: FloatArray
    logits: FloatArray

    @property
    def n_parameters(self) -> int:
        """Number of entries of A and W together."""
        return self.matrices.size + self.logits.size

    def split(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the parts for A (K, d, d) and W (K, F) of a vector (p,): A row by row, then W row by row."""
        size = self.matrices.size
        return parameters[:size].reshape(self.matrices.shape), parameters[size:].reshape(self.logits.shape)

    def stepped(self, step: FloatArray) -> Field:
        """Return the field with ``step`` (p,), ordered as in ``split``, added to its parameters."""
        matrices, logits = self.split(step)
        return Field(self.matrices + matrices, self.logits + logits)

    def velocities(self, positions: FloatArray) -> FloatArray:
        """Return f for positions (d, n), in the same shape."""
        d = len(positions)
        gates = softmax(self.logits @ quadratic_features(positions))
        mixed = self.matrices.reshape(len(gates), d * d).T @ gates
        return np.asarray((mixed.reshape(d, d, -1) * positions).sum(axis=1))

    def linearised(self, positions: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return f, ∂f/∂ξ and ∂f/∂θ for positions (d, n): shapes (n, d), (n, d, d), (n, d, parameters)."""
        d, n = positions.shape
        k, features = self.logits.shape
        phi = quadratic_features(positions)
        gates = softmax(self.logits @ phi)
        images = (self.matrices.reshape(k * d, d) @ positions).reshape(k, d, n)
        f = np.einsum("kn,kin->in", gates, images)
        # ∂h_j/∂logit_k = h_j (δ_jk − h_k), so ∂f/∂logit_k = h_k (A_k ξ − f): the chain rule through softmax.
        spread = gates[:, None] * (images - f)
        slopes = _logit_slopes(self.logits, positions)
        by_state = np.einsum("kn,kij->nij", gates, self.matrices) + np.einsum("kin,kjn->nij", spread, slopes)
        # ∂f_i/∂A_k,lj = h_k ξ_j for l = i and zero otherwise; ∂f/∂W_k = ∂f/∂logit_k φᵀ.
        by_parameter = np.zeros((n, d, self.n_parameters))
        block = by_parameter[:, :, : k * d * d].reshape(n, d, k, d, d)
        weighted = np.einsum("kn,jn->nkj", gates, positions)
        for i in range(d):
            block[:, i, :, i, :] = weighted
        by_parameter[:, :, : k * d * d] = block.reshape(n, d, k * d * d)
        gate_part = spread.transpose(2, 1, 0)[..., None] * phi.T[:, None, None, :]
        by_parameter[:, :, k * d * d :] = gate_part.reshape(n, d, k * features)
        return f.T, by_state, by_parameter


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
    states = np.empty((count + 1, *starts.shape))
    predicted = np.empty_like(states)
    x = starts
    for index in range(count):
        states[index] = x
        slope = field.velocities(x)
        ahead = x + steps * slope
        predicted[index] = ahead
        x = x + 0.5 * steps * (slope + field.velocities(ahead))
    states[count] = predicted[count] = x
    return states, predicted


def rollout_sensitivities(
    field: Field, states: FloatArray, predicted: FloatArray, steps: FloatArray
) -> FloatArray:
    """Return ∂state/∂θ of Heun rollouts, exact for the discrete steps. Shape (count + 1, D, d, p).

    With x⁺ = x + ½ Δt (f(x) + f(y)), y = x + Δt f(x), F = ∂f/∂ξ and G = ∂f/∂θ, the chain rule gives

        ∂x⁺/∂θ = [I + ½ Δt (F(x) + F(y)(I + Δt F(x)))] ∂x/∂θ + ½ Δt [G(x) + G(y) + Δt F(y) G(x)].

    Both brackets are computed for all steps at once; only the product of the first with ∂x/∂θ must go step by
    step.
    """
    count, d, trajectories = states.shape[0] - 1, states.shape[1], states.shape[2]
    here = field.linearised(states[:count].transpose(1, 0, 2).reshape(d, -1))
    ahead = field.linearised(predicted[:count].transpose(1, 0, 2).reshape(d, -1))
    dt = np.tile(steps, count)[:, None, None]
    inner = np.eye(d) + dt * here[1]
    transition = np.eye(d) + 0.5 * dt * (here[1] + ahead[1] @ inner)
    drive = 0.5 * dt * (here[2] + ahead[2] + dt * (ahead[1] @ here[2]))
    transition = transition.reshape(count, trajectories, d, d)
    drive = drive.reshape(count, trajectories, d, -1)
    sensitivities = np.zeros((count + 1, trajectories, d, field.n_parameters))
    for index in range(count):
        np.matmul(transition[index], sensitivities[index], out=sensitivities[index + 1])
        sensitivities[index + 1] += drive[index]
    return sensitivities
