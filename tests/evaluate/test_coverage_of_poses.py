"""Which part of a combined skill of poses acts: regions and demonstrations in the chart of each part."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skillctl.compose.combine import combine
from skillctl.evaluate.coverage import coverage, demonstrated_starts, same_targets, with_regions
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.rollout import rollout
from skillctl.model.seds import SedsSkill


@pytest.fixture(scope="module")
def taught(make_pose_skill):
    """Two skills whose motions start apart and end turned otherwise, and four demonstrations of each."""
    rng = np.random.default_rng(0)
    skills: list[SedsSkill] = []
    sets = []
    for target in [(0.4, -0.1, 0.3, 0, 2, -1), (-0.3, 0.4, 0.2, 1, 0, 2)]:
        skill = make_pose_skill(rng, target=target, rate=1.0)
        offset = np.array([0.3, 0, 0, 0.1, 0, 0]) if not skills else np.array([0, -0.3, 0.1, 0, 0.15, 0])
        starts = skill.space.placed(offset + rng.normal(0, 0.02, (4, 6)), skill.attractor)
        paths = rollout(skill, starts, duration=20.0, period=0.02)
        sets.append(
            tuple(
                Demonstration.from_positions(*paths.trajectory(i), f"motion {i}", skill.space)
                for i in range(4)
            )
        )
        skills.append(skill)
    return skills, [DemonstrationSet(motions, skills[0].space) for motions in sets]


@pytest.mark.parametrize("options", [{}, {"align": True, "target": (0, 0, 0.5, 0, 0, 0, 1)}])
def test_parts_keep_what_they_were_taught(taught, options):
    skills, sets = taught
    combined = with_regions(combine(skills, **options), sets)
    assert [(part.selected, part.kept) for part in coverage(combined, sets)] == [(1.0, 1.0)] * 2
    starts = demonstrated_starts(combined, sets)
    assert combined.part_at(starts).tolist() == [0] * 4 + [1] * 4


def test_starts_are_where_motions_begin_seen_from_their_end(taught):
    skills, sets = taught
    combined = with_regions(combine(skills, align=True, target=(0, 0, 0.5, 0, 0, 0, 1)), sets)
    starts = demonstrated_starts(combined, sets)
    for start, motion in zip(starts, [motion for motions in sets for motion in motions], strict=True):
        first, last = motion.positions[0], motion.positions[-1]
        turn = (
            Rotation.from_rotvec(last[3:].copy()).inv() * Rotation.from_rotvec(first[3:].copy())
        ).as_rotvec()
        assert np.allclose(start, [*(first[:3] - last[:3] + [0, 0, 0.5]), *turn], rtol=0, atol=1e-14)
        charted = np.array([*start[:3], *(skills[0].space.length * turn)])
        means = np.vstack([region.means for region in combined.regions])
        assert np.abs(means - charted).max(axis=1).min() <= 1e-14  # half of a region lies around such starts


def test_targets_in_one_place_are_one_however_they_are_turned(taught, make_pose_skill):
    skills, _ = taught
    for place, named in (((0.4, -0.1, 0.3), 0), ((0.4, -0.1, 0.3001), 1)):
        other = make_pose_skill(np.random.default_rng(1), target=(*place, 0, 2, -1.001))
        assert len(same_targets(combine([skills[0], other]))) == named
