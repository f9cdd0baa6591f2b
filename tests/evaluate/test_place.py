"""What a skill does at one place, and the regions of its parts."""

from __future__ import annotations

import json
from typing import cast

import numpy as np
import pytest

from skillctl.compose.options import CombineOptions, MergeOptions
from skillctl.errors import UsageError
from skillctl.model.combined import CombinedSkill
from skillctl.model.rollout import ARRIVAL_DISTANCE
from skillctl.usecases.combine import combine
from skillctl.usecases.files import load
from skillctl.usecases.inspect import inspect
from skillctl.usecases.merge import merge


@pytest.fixture
def both(library, tmp_path):
    path = tmp_path / "c.h5"
    combine(["curve", "hook"], output=path, store=library, options=CombineOptions(part_priors=(2, 1)))
    return path


def test_a_combined_skill_says_which_part_acts_and_where_the_motion_ends(both, library):
    skill = load(both)
    for index, name in enumerate(("curve", "hook")):
        start = inspect(name, store=library).leaves[0].joint_mixture.means[:, :2].mean(axis=0)
        place = inspect(both, position=start.tolist()).at
        assert (place.part, place.attractor, place.arrives) == (index + 1, index + 1, True)
        # The motion is followed to the arrival distance of a millimetre.
        assert np.linalg.norm(np.array(place.end) - skill.attractors[index]) < ARRIVAL_DISTANCE
        assert place.velocity == pytest.approx(skill.parts[index].velocity(start))
        assert sum(place.weights) == pytest.approx(1)
        assert int(np.argmax(place.weights)) == index


def test_weights_are_the_priors_times_the_regions(both):
    skill = load(both)
    x = 0.5 * (skill.attractors[0] + skill.attractors[1])
    values = [
        prior * np.exp(region.log_density(x[None])[0])
        for prior, region in zip((2 / 3, 1 / 3), cast(CombinedSkill, skill).regions, strict=True)
    ]
    weights = inspect(both, position=x.tolist()).at.weights
    assert weights == pytest.approx(np.array(values) / sum(values), rel=1e-9)  # exp of logs of about 10


def test_regions_hold_prior_attractor_and_share_of_own_starts(both, library):
    regions = inspect(both).regions
    assert [region.prior for region in regions] == pytest.approx([2 / 3, 1 / 3])
    assert [region.demonstrations for region in regions] == [4, 4]
    skill = load(both)
    ends = [tuple(part.attractors[0].tolist()) for part in skill.parts]
    assert [region.attractor for region in regions] == ends
    assert all(0 <= region.selected <= 1 for region in regions)
    assert inspect("curve", store=library).regions == ()


def test_merged_and_learned_skills_name_no_acting_part(library, tmp_path):
    options = MergeOptions(part_weights=(3, 1))
    merge(["curve", "hook"], output=tmp_path / "m.h5", store=library, options=options)
    place = inspect(tmp_path / "m.h5", position=(0.1, 0.1)).at
    assert (place.part, place.attractor) == (None, 1)
    assert place.weights == pytest.approx((0.75, 0.25))
    assert inspect("curve", store=library, position=(0.1, 0.1)).at.weights == (1.0,)
    assert inspect("curve", store=library).at is None


@pytest.mark.parametrize("position", [(0.1,), (0.1, 0.2, 0.3), (float("nan"), 0.0)])
def test_a_place_of_another_space_is_refused(library, position):
    with pytest.raises(UsageError, match=r"at: expected 2 finite numbers \(x, y\)"):
        inspect("curve", store=library, position=position)


def test_the_command_shows_it_to_people_and_programs(run, both):
    text = run("inspect", both, "--at", "-0.1,-0.2")
    assert (text.exit_code, text.stderr) == (0, "")
    for word in ("acts      part 2", "motion    arrives after", "left-out starts in it"):
        assert word in text.stdout
    document = json.loads(run("inspect", both, "--at", "-0.1,-0.2", "--json").stdout)
    assert document["at"]["part"] == 2
    assert len(document["regions"]) == 2
    assert run("inspect", both, "--at", "1").exit_code == 2
