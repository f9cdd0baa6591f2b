"""When the search for a witness may speak: a motion that arrives, however late, is none."""

from dataclasses import replace

import numpy as np
import pytest

from skillctl.model.combined import CombinedSkill
from skillctl.model.mixture import GaussianMixture
from skillctl.model.rollout import ARRIVAL_DISTANCE
from skillctl.stability.certificate import certify

BORDER, FAR = 0.05, 1.0  # [m]: how far before its target the region of the first part ends; the second target
LEFTMOST = -0.33  # [m]: the search starts within three standard deviations of the first density
RATES = (1.0, 0.5)  # [1/s], of the two parts along the way


@pytest.fixture
def transit(make_skill):
    """Return a maker of skills whose motions run through the region of one part to the target of the next.

    Along x the parts go to their targets at RATES, along y at ``fastest``. The first part acts left of
    −BORDER and its target is the origin, in the region of the second, whose target is at FAR. So every motion
    that starts left goes towards the origin, crosses the border, and goes on to FAR: it needs the
    logarithms of both ways, and arrives.
    """

    def make(fastest):
        skill = make_skill(np.random.default_rng(0), n_components=1)
        parts = []
        # The first target lies 0.02 beside the way, so that nothing passes within the arrival distance.
        for target, side, rate in (([0.0, 0.02], -0.13, RATES[0]), ([FAR, 0.0], 0.13, RATES[1])):
            density = GaussianMixture([1.0], [[side - BORDER, 0.0]], [0.05**2 * np.eye(2)])
            matrices = np.diag([-rate, -fastest])[None]
            parts.append(replace(skill, system_matrices=matrices, attractor=target, density=density))
        return CombinedSkill(tuple(parts), [0.5, 0.5], "instantaneous")

    return make


def arrival_time(start):
    """Return when the motion from x = start < −BORDER arrives at FAR, by solving ẋ = −r (x − x*) twice."""
    return np.log(-start / BORDER) / RATES[0] + np.log((FAR + BORDER) / ARRIVAL_DISTANCE) / RATES[1]


def test_a_motion_that_takes_longer_than_one_part_alone_is_followed_to_its_end(transit):
    sampling = certify(transit(fastest=100.0)).sampling
    # The search has to go on for longer than one part needs at most, or this is a test of nothing.
    alone = np.log((FAR - LEFTMOST) / ARRIVAL_DISTANCE) / RATES[1]
    assert arrival_time(-0.3) > alone
    assert sampling.duration > alone
    assert (sampling.arrived, sampling.witness) == (sampling.starts, None)


def test_a_motion_that_gains_less_than_one_part_alone_but_goes_on_is_no_witness(transit):
    # So stiff that the search ends after 2.5 s. Those that crossed the border in the second half have by then
    # come nearer to FAR by less than a part alone guarantees, and they do arrive, some seconds later.
    sampling = certify(transit(fastest=1000.0)).sampling
    crossing = np.log(0.3 / BORDER)
    assert 0.5 * sampling.duration < crossing < sampling.duration < arrival_time(-0.3)
    assert sampling.arrived < sampling.starts
    assert sampling.witness is None
