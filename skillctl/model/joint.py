"""The Gaussian mixture over positions and velocities that Eq. 2 speaks of and other SEDS tools use."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.model.seds import SedsSkill


@dataclass(frozen=True, eq=False)
class JointMixture:
    """A Gaussian mixture over [ξ; ξ̇]; ξ is a charted state (see ``model.space.Space``).

    Attributes:
        priors: Shape (K,).
        means: Of [ξ; ξ̇], shape (K, 2d).
        covariances: Shape (K, 2d, 2d).
    """

    priors: FloatArray
    means: FloatArray
    covariances: FloatArray


def joint_mixture(skill: SedsSkill) -> JointMixture:
    """Return the mixture over [ξ; ξ̇] whose regression is the skill.

    Mean of ξ̇: Aₖ (μₖ − ξ*), where ξ* is the anchor; Σ_ξ̇ξ = Aₖ Σₖ; Σ_ξ̇ξ̇ = Aₖ Σₖ Aₖᵀ + Cₖ, with the skill's
    speed in Aₖ and Cₖ.

    References:
        Eq. 2, solved for the joint moments.
    """
    matrices, sigma = skill.component_matrices, skill.covariances
    velocities = np.einsum("kij,kj->ki", matrices, skill.means - skill.anchor)
    cross = matrices @ sigma
    spread = cross @ matrices.swapaxes(1, 2) + skill.speed**2 * skill.residual_covariances
    covariances = np.block([[sigma, cross.swapaxes(1, 2)], [cross, spread]])
    return JointMixture(skill.priors, np.hstack([skill.means, velocities]), covariances)
