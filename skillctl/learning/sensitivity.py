"""How rollouts depend on the parameters of the field: exact gradients, and sensitivities at a few times.

One step of Heun's method, x⁺ = x + ½ Δt (f(x) + f(y)) with y = x + Δt f(x), depends on the state and on θ by

    dx⁺ = T dx + M_x ∂f(x)/∂θ dθ + M_y ∂f(y)/∂θ dθ,      T = I + ½ Δt (F(x) + F(y)(I + Δt F(x))),
    M_x = ½ Δt (I + Δt F(y)),   M_y = ½ Δt I,             F = ∂f/∂ξ.

∂f/∂θ is never written out: it has d·p numbers a point, and its factors (see ``Linearised``) about K (d + F).
"""

from __future__ import annotations

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.learning.blocks import spans
from skillctl.learning.field import Field


class RolloutSlopes:
    """The derivatives of Heun rollouts of D trajectories with ``count`` steps."""

    def __init__(self, field: Field, states: FloatArray, predicted: FloatArray, steps: FloatArray) -> None:
        """Args: field; states and predicted of ``heun_rollouts``; steps: Δt of each trajectory (D,)."""
        self.count, d, self.trajectories = states.shape[0] - 1, states.shape[1], states.shape[2]
        points = np.stack([states[:-1], predicted[:-1]], axis=1)  # (count, 2, d, D)
        self.at = field.linearised(points.transpose(2, 0, 1, 3).reshape(d, -1))  # n: step, x or y, trajectory
        slopes = field.by_state(self.at).reshape(self.count, 2, self.trajectories, d, d)
        dt, eye = steps[:, None, None], np.eye(d)
        second = 0.5 * dt * (eye + dt * slopes[:, 1])
        self.transitions = eye + second @ slopes[:, 0] + 0.5 * dt * slopes[:, 1]
        self.drives = np.stack([second, np.broadcast_to(0.5 * dt * eye, second.shape)], axis=1)

    def gradient(self, pulls: FloatArray) -> FloatArray:
        """Return Σ (∂state/∂θ)ᵀ pull for pulls (count + 1, D, d), going back in time. Shape (p,)."""
        adjoint = pulls[1:].copy()
        for step in range(self.count - 1, 0, -1):
            # λᵀT of every trajectory
            adjoint[step - 1] += (adjoint[step][:, None] @ self.transitions[step])[:, 0]
        forces = (adjoint[:, None, :, None] @ self.drives)[..., 0, :]  # (count, 2, D, d)
        return self.at.pull_back(forces.reshape(-1, forces.shape[-1]).T)

    def at_nodes(self, every: int) -> FloatArray:
        """Return ∂state/∂θ after each block of ``every`` steps, the first block perhaps shorter.

        Shape (blocks, D, d, p); the last is that of the final state.
        """
        d = len(self.at.positions)
        rest, drives = self._over_blocks(every)
        shape = *rest.shape[:2], d
        # Row l of A_k moves coordinate i as far as the drive's entry (i, l) says.
        inputs = self._by_block(self.at.gates[:, None] * self.at.positions, every)
        matrices = [self._of_block(drives, inputs, span) for span in spans(self.at.blocks)]
        moved = np.einsum("bjilp,bjklp->bjikp", drives, self._by_block(self.at.spread, every))
        features = self._by_block(self.at.features, every).swapaxes(2, 3)
        logits = moved.reshape(*shape[:2], -1, moved.shape[-1]) @ features
        entries = np.concatenate(matrices, axis=4).reshape(*shape, -1)
        table = np.concatenate([entries, logits.reshape(*shape, -1)], axis=3)
        for block in range(1, len(table)):
            table[block] += rest[block] @ table[block - 1]
        return table

    @staticmethod
    def _of_block(drives: FloatArray, inputs: FloatArray, span: slice) -> FloatArray:
        """Return the part of the table of the entries of one block of every A_k. Shape (blocks, D, d, K, b²).

        Args:
            drives: Shape (blocks, D, d, d, 2 · every).
            inputs: Shape (blocks, D, K, d, 2 · every).
            span: Coordinates of the block.
        """
        length = span.stop - span.start
        driven, gated = drives[:, :, :, span], inputs[:, :, :, span]
        shape = driven.shape[:3]
        gated = gated.reshape(*shape[:2], -1, inputs.shape[-1]).swapaxes(2, 3)
        product = driven.reshape(*shape[:2], shape[2] * length, -1) @ gated
        moved = product.reshape(*shape, length, -1, length).swapaxes(3, 4)
        return np.asarray(moved.reshape(*shape, moved.shape[3], -1))

    def _over_blocks(self, every: int) -> tuple[FloatArray, FloatArray]:
        """Return T of blocks (blocks, D, d, d), and what M_x and M_y do until their ends (…, 2 · every)."""
        d, lead = len(self.at.positions), -self.count % every
        transitions = np.concatenate([np.tile(np.eye(d), (lead, self.trajectories, 1, 1)), self.transitions])
        transitions = transitions.reshape(-1, every, self.trajectories, d, d)
        drives = self._by_block(self.drives.transpose(3, 4, 0, 1, 2).reshape(d, d, -1), every)
        rest = transitions[:, -1]
        for step in range(every - 2, -1, -1):
            pair = slice(2 * step, 2 * step + 2)
            drives[..., pair] = np.einsum("bjil,bjlmp->bjimp", rest, drives[..., pair])
            rest = rest @ transitions[:, step]
        return rest, drives

    def _by_block(self, values: FloatArray, every: int) -> FloatArray:
        """Return values (…, n) as (blocks, D, …, 2 · every); steps before the first have zeros."""
        steps = values.reshape(-1, self.count, 2, self.trajectories)
        steps = np.pad(steps, ((0, 0), (-self.count % every, 0), (0, 0), (0, 0)))
        steps = steps.reshape(len(steps), -1, 2 * every, self.trajectories)
        return steps.transpose(1, 3, 0, 2).reshape(
            steps.shape[1], self.trajectories, *values.shape[:-1], 2 * every
        )
