"""Proofs of skills that move poses: what they say is seen in motions, and what is not true is not said."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from skillctl.model.combined import CombinedSkill
from skillctl.model.coordinates.chain import Chain
from skillctl.model.merged import MergedSkill
from skillctl.stability.certificate import certify
from skillctl.stability.reach import bound_reach

SEAM = "every position and every orientation but those exactly 180° from the target's"


def random_p(rng):
    root = rng.normal(size=(3, 3))
    p = root @ root.T + 0.3 * np.eye(3)
    return 0.5 * (p + p.T)


def matrix_at(skill, k, row, column, value):
    matrices = skill.system_matrices.copy()
    matrices[k, row, column] = value
    return replace(skill, system_matrices=matrices)


def turned_anyhow(rng, count):
    """Poses around the target, in every orientation; some within a millionth of half a turn from it."""
    turns = Rotation.random(count, random_state=rng)
    axes = rng.normal(size=(10, 3))
    near = Rotation.from_rotvec((np.pi - 1e-6) * axes / np.linalg.norm(axes, axis=1)[:, None])
    return np.hstack(
        [rng.normal(0.4, 0.3, (count, 3)), np.vstack([turns[:-10].as_rotvec(), near.as_rotvec()])]
    )


@pytest.mark.parametrize("bent", [False, True])
def test_both_parts_are_proved_apart_and_together(make_pose_skill, bent):
    rng = np.random.default_rng(4)
    skill = make_pose_skill(rng, lyapunov=random_p(rng), n_components=4, rate=0.4, speed=1.5, bent=bent)
    certificate = certify(skill)
    assert (certificate.verdict, certificate.scope) == ("stable", "global")
    (part,) = certificate.parts
    assert [block.name for block in part.blocks] == ["position", "orientation"]
    for block, rows in zip(part.blocks, (slice(0, 3), slice(3, 6)), strict=True):
        p = skill.lyapunov[rows, rows]
        matrices = 1.5 * skill.system_matrices[:, rows, rows]
        losses = [-(p @ a + a.T @ p) for a in matrices]
        rate = min(eigh(0.5 * loss, p, eigvals_only=True)[0] for loss in losses)
        period = min(
            eigh(loss, a.T @ p @ a, eigvals_only=True)[0] for loss, a in zip(losses, matrices, strict=True)
        )
        # The first rounding towards safety is 2^-40, far above the rounding of either eigenvalue solver.
        assert rate * (1 - 2.0**-38) <= block.rate < rate
        assert period * (1 - 2.0**-38) <= block.period < period
    assert certificate.rate == min(block.rate for block in part.blocks)
    assert certificate.period == min(block.period for block in part.blocks)
    assert certificate.proof[0].endswith(f"from {SEAM}.")
    assert "the angle to the orientation there" in certificate.proof[1]


@pytest.mark.parametrize("bent", [False, True])
def test_no_step_up_to_the_proved_period_turns_away(make_pose_skill, bent):
    """The oracle is SciPy's: its rotations, and the angles between them."""
    rng = np.random.default_rng(8)
    skill = make_pose_skill(rng, lyapunov=random_p(rng), rate=0.3, bent=bent)
    period = certify(skill).period
    target = Rotation.from_rotvec(skill.attractor[3:].copy())

    def angles(states):
        return (target.inv() * Rotation.from_rotvec(states[:, 3:])).magnitude()

    for share in (1e-3, 0.3, 1.0):
        states = turned_anyhow(rng, 200)
        for _ in range(30):
            ahead = skill.advanced(states, share * period)
            # Quaternions, logarithm and exponential: some ten roundings of numbers of up to π.
            assert (angles(ahead) <= angles(states) + 1e-14).all()
            states = ahead


def test_the_rate_of_the_angle_holds(make_pose_skill):
    rng = np.random.default_rng(2)
    skill = make_pose_skill(rng, rate=0.5)
    (_, turning), period = certify(skill).parts[0].blocks, 0.01
    states = turned_anyhow(rng, 100)
    start = np.linalg.norm(skill.space.offsets(states, skill.attractor)[:, 3:], axis=1)
    for step in range(1, 200):
        states = skill.advanced(states, period)
        left = np.linalg.norm(skill.space.offsets(states, skill.attractor)[:, 3:], axis=1)
        # Steps of a period lose a little of the rate of the flow: Δt/2 ‖A‖² ‖r‖ at most.
        assert (left <= start * np.exp(-0.8 * turning.rate * step * period) + 1e-12).all()


@pytest.mark.parametrize(
    ("row", "column", "value"), [(0, 4, 1e-100), (5, 1, -1e-9)], ids=["smallest number", "small number"]
)
def test_a_coupled_matrix_is_no_global_proof(make_pose_skill, row, column, value):
    skill = matrix_at(make_pose_skill(np.random.default_rng(0)), 1, row, column, value)
    certificate = certify(skill)
    assert (certificate.verdict, certificate.scope) == ("not proved", "local")
    assert certificate.failures == ("part 1: leaf 1, component 2: A couples position and orientation.",)
    assert not certificate.parts[0].blocks
    assert "every motion ends there" in certificate.proof[-1]
    assert SEAM not in " ".join(certificate.proof)


def test_a_coupled_radius_is_seen(make_pose_skill):
    """P couples, too, so motions may turn away for a while; within R none reaches the seam."""
    rng = np.random.default_rng(3)
    plain = make_pose_skill(rng, rate=0.5)
    mixing = np.eye(6)
    mixing[3:, :3] = rng.normal(0, 0.5, (3, 3))
    inverse = np.linalg.inv(mixing)
    p = mixing.T @ mixing
    coupled = replace(
        plain,
        system_matrices=inverse @ plain.system_matrices @ mixing,
        lyapunov=0.5 * (p + p.T),
    )
    certificate = certify(coupled)
    assert (certificate.verdict, certificate.scope) == ("not proved", "local")
    assert "part 1: P couples position and orientation." in certificate.failures
    radius, space = certificate.parts[0].radius, coupled.space
    # What is known of V by eigenvalues: the largest ball in {V ≤ c}, c = (πℓ)² / λ_max of that block of P⁻¹.
    level = (np.pi * space.length) ** 2 / np.linalg.eigvalsh(np.linalg.inv(p)[3:, 3:])[-1]
    assert radius == pytest.approx(np.sqrt(level / np.linalg.eigvalsh(p)[-1]), rel=1e-9)
    offsets = rng.normal(size=(300, 6))
    offsets *= 0.999 * radius / np.linalg.norm(offsets, axis=1)[:, None]
    states = space.placed(offsets, coupled.attractor)
    for _ in range(400):
        before, states = coupled.v_distance(states), coupled.advanced(states, 0.9 * certificate.period)
        assert (coupled.v_distance(states) <= before + 1e-14).all()
    assert space.distance(states, coupled.attractor).max() < radius


def test_only_multiples_of_the_identity_measure_angles(make_pose_skill):
    skill = make_pose_skill(np.random.default_rng(5))
    p = skill.lyapunov.copy()
    p[3:, 3:] *= 0.3
    assert certify(replace(skill, lyapunov=p)).verdict == "stable"
    p[4, 4] = np.nextafter(p[4, 4], 1)
    certificate = certify(replace(skill, lyapunov=p))
    assert certificate.verdict == "not proved"
    assert certificate.failures == ("part 1: P of the orientation is no multiple of the identity.",)


def test_coordinates_must_leave_the_orientation_alone(make_pose_skill, make_shears):
    rng = np.random.default_rng(6)
    skill = replace(make_pose_skill(rng), coordinates=Chain((make_shears(rng, 6),)))
    certificate = certify(skill)
    assert (certificate.verdict, certificate.scope) == ("not proved", "none")
    assert certificate.failures == ("part 1: coordinates bend the orientation.",)


def test_an_unstable_orientation_is_not_proved(make_pose_skill):
    skill = matrix_at(make_pose_skill(np.random.default_rng(7)), 0, 3, 3, 2.0)
    certificate = certify(skill)
    assert (certificate.verdict, certificate.scope) == ("not proved", "none")
    assert "leaf 1, component 1: P A + Aᵀ P is not negative definite" in certificate.failures[0]


def test_trees_of_poses(make_pose_skill):
    rng = np.random.default_rng(9)
    one, other = make_pose_skill(rng), make_pose_skill(rng)
    far = make_pose_skill(rng, target=(0.0, 0.5, 0.2, 1.0, 0.0, 0.0))
    halves = [0.5, 0.5]
    for skill in (
        MergedSkill((one, other), halves),
        CombinedSkill((one, far), halves),
        CombinedSkill((one, other), halves, "instantaneous"),
    ):
        certificate = certify(skill)
        assert (certificate.verdict, certificate.scope) == ("stable", "global")
        assert SEAM in certificate.proof[0]
    certificate = certify(CombinedSkill((one, far), halves, "instantaneous"))
    assert certificate.scope == "none"
    assert certificate.verdict in {"inconclusive", "not proved"}  # sampling may find a witness, or not


def test_the_arrival_is_that_of_the_later_part(make_pose_skill):
    """Of ẏ = −y all is known: √V shrinks by 1 − Δt/2 1/s or more, from half a turn and from the start."""
    skill = make_pose_skill(np.random.default_rng(1), n_components=1, length=0.2)
    skill = replace(skill, system_matrices=-np.eye(6)[None], lyapunov=np.eye(6))
    certificate, period, near = certify(skill), 0.1, 1e-3 / np.sqrt(2)
    for away in (0.1, 10.0):
        corner = skill.attractor[:3] + np.array([away, 0, 0])
        reach = bound_reach(skill, certificate, corner, corner, period=period)
        farthest = max(away, np.pi * 0.2)
        expected = np.log(farthest / near) / (1 - period / 2) + period
        assert reach.arrival == pytest.approx(expected, rel=1e-9)
        assert reach.arrival_distance == 1e-3


@pytest.mark.parametrize("bent", [False, True])
def test_a_box_of_positions_is_left_in_no_orientation(make_pose_skill, bent):
    rng = np.random.default_rng(10)
    skill = make_pose_skill(rng, lyapunov=random_p(rng), rate=0.5, bent=bent)
    reach = bound_reach(skill, certify(skill), [0.5, 0.0, 0.2], [0.7, 0.1, 0.4])
    assert reach.names == ("x", "y", "z")
    assert reach.measured.arrived == reach.measured.starts
    assert reach.measured.arrival <= reach.arrival
    low, high = np.array(reach.low), np.array(reach.high)
    if not bent:  # the ellipse around the largest V at a vertex, of the position alone
        p, target = skill.lyapunov[:3, :3], skill.attractor[:3]
        vertices = np.stack(np.meshgrid([0.5, 0.7], [0.0, 0.1], [0.2, 0.4]), axis=-1).reshape(-1, 3) - target
        level = max(v @ p @ v for v in vertices)
        assert high - target == pytest.approx(np.sqrt(level * np.diag(np.linalg.inv(p))), rel=1e-12)
    states = np.hstack(
        [rng.uniform([0.5, 0, 0.2], [0.7, 0.1, 0.4], (200, 3)), turned_anyhow(rng, 200)[:, 3:]]
    )
    steps = int(reach.arrival / reach.period) + 1
    for _ in range(min(steps, 2000)):
        assert (low <= states[:, :3]).all()
        assert (states[:, :3] <= high).all()
        states = skill.advanced(states, reach.period)
    if steps <= 2000:
        assert (skill.space.distance(states, skill.attractor) <= reach.arrival_distance).all()
