"""Weights are chosen for each target and scene, and the proof of the parts covers them all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="PyBullet has wheels for CPython 3.10 and 3.11 on Linux x86_64 only")

from skillctl.adapt.per_target import GRIDS, Weighing, adapted, grid
from skillctl.compose.merge import merge, with_weights
from skillctl.errors import UsageError
from skillctl.learning.fit import fit
from skillctl.model.combined import CombinedSkill
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.retarget import retargeted
from skillctl.model.rollout import rollout
from skillctl.model.space import Euclidean
from skillctl.simulation.scenario import Scenario
from skillctl.stability.certificate import certify
from skillctl.usecases.check_reach import check_reach
from skillctl.usecases.files import save
from skillctl.usecases.simulate import simulate
from skillctl.usecases.simulate_many import simulate_many

START, GOAL = np.array([0.5, -0.25, 0.5]), np.array([0.5, 0.25, 0.5])
POST = {"kind": "cylinder", "name": "post", "radius": 0.02, "height": 0.5}


@pytest.fixture(scope="module")
def swinging():
    """Return a merger of two reaches, one that swings forwards and one that swings backwards."""
    t = np.linspace(0, 1, 80)[:, None]
    line = START + (GOAL - START) * (10 * t**3 - 15 * t**4 + 6 * t**5)
    parts = []
    for way in (-0.15, 0.15):
        bow = line + way * np.sin(np.pi * t) ** 2 * np.array([1.0, 0.0, 0.0])
        shown = DemonstrationSet((Demonstration.from_positions(3 * t[:, 0], bow),), Euclidean.cartesian(3))
        parts.append(retargeted(fit(shown).skill, GOAL))
    return merge(parts, lyapunov=np.eye(3)) if _contract(parts) else pytest.skip("no common proof")


def _contract(parts):
    return all(certify(merge([part, part], lyapunov=np.eye(3))).verdict == "stable" for part in parts)


def scenario(x: float) -> Scenario:
    return Scenario(
        start=tuple(START), target=tuple(GOAL), obstacles=[{**POST, "position": (x, 0.0, 0.5)}], base_yaw=0.0
    )


def middle_of(skill):
    """Return how far forwards the motion is where it crosses y = 0."""
    path = rollout(skill, START[None], duration=10.0, period=0.01).positions[0]
    return float(np.interp(0.0, path[:, 1], path[:, 0]))


def test_the_motion_goes_to_the_free_side_of_a_post(swinging):
    before, behind = (adapted(swinging, scenario(x)) for x in (0.62, 0.38))
    assert middle_of(before) < 0.5 < middle_of(behind)


def test_weights_are_found_where_equal_ones_would_touch(swinging):
    weighing = Weighing.of(swinging, scenario(0.5))
    tried = grid(2)
    margins = weighing.margins(tried)
    best = weighing.best(tried)
    bodies = [values for name, values in margins.items() if name != "target"]
    scored = np.min([values.min(axis=1) for values in bodies], axis=0)
    chosen = next(i for i, weights in enumerate(tried) if (weights == best).all())
    assert scored[0] < 0 <= scored[chosen]  # the first are equal weights


def test_every_weighting_is_proved_by_the_proof_of_the_merged_skill(swinging):
    whole = certify(swinging)
    assert whole.verdict == "stable"
    for weights in ([1, 0], [0, 3], [0.2, 0.8], [1e-9, 1]):
        found = with_weights(swinging, weights)
        certificate = certify(found)
        assert certificate.verdict == "stable"
        assert certificate.rate >= whole.rate
        assert certificate.period >= whole.period
        x = np.array([0.45, 0.1, 0.55])
        expected = sum(
            w / np.sum(weights) * part.velocity(x) for w, part in zip(weights, swinging.parts, strict=True)
        )
        # Sums of a few dozen products, in another order.
        assert found.velocity(x) == pytest.approx(swinging.speed * expected, rel=1e-11)


@pytest.mark.parametrize("weights", [[0, 0], [1, -1], [1], [1, np.nan]])
def test_weights_that_mean_nothing_are_refused(swinging, weights):
    with pytest.raises(UsageError, match="weights"):
        with_weights(swinging, weights)


def test_only_merged_skills_of_a_few_parts_have_weights_to_choose(swinging):
    part = swinging.parts[0]
    for skill in (part, CombinedSkill(swinging.parts, [0.5, 0.5])):
        with pytest.raises(UsageError, match=f"this is a {skill.kind} one"):
            adapted(skill, scenario(0.6))
    many = max(GRIDS) + 1
    with pytest.raises(UsageError, match=f"not of {many}"):
        adapted(replace(swinging, parts=(part,) * many, part_weights=np.full(many, 1 / many)), scenario(0.6))


def test_where_nothing_is_in_the_way_a_skill_keeps_its_weights(swinging):
    own = with_weights(swinging, [0.37, 0.63])
    found = adapted(own, scenario(0.5).changed(obstacles=()))
    assert found.shares == pytest.approx([0.37, 0.63], rel=1e-15)


def test_gates_that_the_search_does_not_follow_are_refused(swinging):
    sharp = replace(swinging, gate="experts", parameters={"sharpness": 2.0})
    with pytest.raises(UsageError, match="defaults of the experts gate"):
        adapted(sharp, scenario(0.5))
    assert adapted(replace(sharp, parameters={}), scenario(0.5)).gate == "experts"


def test_a_simulated_arm_passes_a_post_that_it_touches_with_equal_weights(swinging, tmp_path):
    path = save(swinging, tmp_path / "swinging.h5")
    post = scenario(0.5).changed(avoid=False)
    plain, chosen = (simulate(path, post.changed(adapt=adapt)) for adapt in (False, True))
    assert (plain.outcome, chosen.outcome) == ("shelf_contact", "reached")
    assert any(note.startswith("weights chosen for this target and scene: ") for note in chosen.notes)
    many = simulate_many(path, post.changed(adapt=True, noise=1e-4, episodes=1))
    assert many.successes == 1
    assert check_reach(path, post.changed(adapt=True)).reachability.reachable
    assert not check_reach(path, post).reachability.reachable
    part = save(swinging.parts[0], tmp_path / "part.h5")
    with pytest.raises(UsageError, match="weights of a merged skill; this is a seds one"):
        simulate(part, post.changed(adapt=True))
