"""Coordinates in front of the mixture: a link of the tests' own shows that the proof goes through them."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from skillctl.errors import InvalidModelError
from skillctl.model.combined import CombinedSkill
from skillctl.model.controller import Controller
from skillctl.model.coordinates.chain import IDENTITY, Chain, Link
from skillctl.model.merged import MergedSkill
from skillctl.model.rollout import rollout
from skillctl.model.skill import contraction_period
from skillctl.model.stepper import Caps, Stepper
from skillctl.stability.certificate import certify

EPS = np.finfo(float).eps


@dataclass(frozen=True)
class Bend(Link):
    """y = (x₁, x₂ + a (cos x₁ − 1)): a shear, with its inverse and differential in closed form."""

    strength: float = 0.3

    def _bump(self, first):
        return self.strength * (np.cos(first) - 1)

    def forward(self, offsets):
        return np.stack([offsets[:, 0], offsets[:, 1] + self._bump(offsets[:, 0])], axis=1)

    def back(self, coordinates):
        return np.stack([coordinates[:, 0], coordinates[:, 1] - self._bump(coordinates[:, 0])], axis=1)

    def tangent(self, offsets):
        slope = -self.strength * np.sin(offsets[:, 0])
        return self.forward(offsets), lambda v: np.stack([v[:, 0], v[:, 1] - slope * v[:, 0]], axis=1)

    def in_unit(self, unit):
        raise NotImplementedError

    def check(self):
        return () if np.isfinite(self.strength) else ("the bend is not finite.",)


BENT = Chain((Bend(0.3), Bend(-0.8)))


@pytest.fixture
def bent(make_skill):
    rng = np.random.default_rng(3)
    return replace(make_skill(rng, attractor=[0.0, 0.0]), coordinates=BENT)


@pytest.fixture
def states():
    return np.random.default_rng(4).normal(0, 1.0, (50, 2))


def test_a_chain_leads_there_and_back(states):
    assert np.abs(BENT.back(BENT.forward(states)) - states).max() <= 16 * EPS * np.abs(states).max()
    assert (IDENTITY.forward(states) == states).all()
    assert BENT.check() == ()
    assert Chain((Bend(0.1), Bend(np.nan))).check() == ("the bend is not finite.",)


def test_velocities_are_those_of_the_mixture_seen_through_the_map(bent, states):
    step = 1e-6
    y = BENT.forward(states)
    moved = y + step * replace(bent, coordinates=IDENTITY).velocity(y)
    differences = (BENT.back(moved) - states) / step
    # Forward differences err by half a step times the second derivative, and by rounding over the step.
    scale = np.abs(differences).max() ** 2
    assert np.abs(bent.velocity(states) - differences).max() <= step * (1 + scale) + 64 * EPS / step
    single = np.stack([bent.velocity(state) for state in states])
    # One product of all states is summed in another order than one for each.
    assert np.abs(single - bent.velocity(states)).max() <= 1e3 * EPS * np.abs(single).max()


def test_v_falls_at_every_step_of_the_proved_period(bent, states):
    stepper = Stepper(bent, certify(bent).period)
    before = bent.v_distance(states)
    after = bent.v_distance(stepper.step_many(states).states)
    assert (after < before).all()
    assert np.abs(bent.v_distance(bent.attractors)).max() == 0


def test_a_step_leads_where_its_command_does(bent, states):
    many = Stepper(bent, 0.02).step_many(states)
    for state, ahead in zip(states, many.states, strict=True):
        one = Stepper(bent, 0.02).step(state)
        # The command is a difference, divided by the period: two roundings of numbers of this size.
        assert np.abs(one.states - (state + 0.02 * one.command)).max() <= 4 * EPS * (1 + np.abs(state).max())
        assert np.abs(one.states - ahead).max() <= 8 * EPS * (1 + np.abs(ahead).max())


def test_a_cap_is_kept_by_a_shorter_step_along_the_mixture(bent, states):
    stepper = Stepper(bent, 0.02)
    for state in states[:10]:
        free = stepper.step(state)
        cap = 0.3 * float(np.linalg.norm(free.command))
        capped = stepper.step(state, caps=Caps(cap))
        assert cap * (1 - 1e-9) <= np.linalg.norm(capped.command) <= cap  # CLOSE is 1e-10
        ahead, full = (BENT.forward(step.states[None])[0] for step in (capped, free))
        here = BENT.forward(state[None])[0]
        # In coordinates the capped step goes the same way as the full one, only less far.
        turned = np.cross(np.append(ahead - here, 0), np.append(full - here, 0))[2]
        lengths = np.linalg.norm(ahead - here) * np.linalg.norm(full - here)
        assert abs(turned) <= 1e-9 * lengths
        assert bent.v_distance(capped.states[None]) < bent.v_distance(state[None])


def test_rollouts_and_controllers_arrive(bent, states):
    period = 0.5 * contraction_period(bent)
    assert rollout(bent, states, duration=200.0, period=period).arrived.all()
    controller, x = Controller(bent, period), states[0]
    for _ in range(round(200.0 / period)):
        x = x + period * controller.step(x)
    assert np.linalg.norm(x) < 1e-3


def test_moving_the_skill_moves_its_coordinates(bent, states):
    offset = np.array([0.5, -1.0])
    moved = bent.translated(offset).velocity(states + offset)
    scale = np.abs(bent.velocity(states)).max()
    assert np.abs(moved - bent.velocity(states)).max() <= 1e5 * EPS * scale


def test_parts_of_a_merger_share_coordinates_and_those_of_a_combination_need_not(bent):
    plain = replace(bent, coordinates=IDENTITY)
    with pytest.raises(InvalidModelError, match="parts: must share their coordinates"):
        MergedSkill((bent, plain), [0.5, 0.5])
    merged = MergedSkill((bent, bent), [0.3, 0.7])
    x = np.array([[0.4, 0.7]])
    assert np.abs(merged.velocity(x) - bent.velocity(x)).max() <= 1e5 * EPS
    both = CombinedSkill((bent, plain), [0.5, 0.5])
    assert (both.velocity(x, 0) == bent.velocity(x)).all()
    assert (both.velocity(x, 1) == plain.velocity(x)).all()
    step = Stepper(both, 0.02).step_many(np.repeat(x, 2, axis=0), np.array([0, 1]))
    assert np.abs(step.states[0] - Stepper(bent, 0.02).step_many(x).states[0]).max() <= 4 * EPS
    assert np.abs(step.states[1] - (x[0] + 0.02 * plain.velocity(x[0]))).max() <= 4 * EPS
