"""A cup that a chain carries: the rules, with fingers and a cup of numbers only, and a hand in physics."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from skillctl.errors import UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.model.seds import SedsSkill
from skillctl.simulation.episode import Episode
from skillctl.simulation.handling import STANDS, TRIES, Handling
from skillctl.simulation.judge import Verdict
from skillctl.simulation.run import simulate
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scene import Contact

MakeLinear = Callable[..., SedsSkill]
PERIOD = 1 / 240
CUP = np.array([0.62, 0.0, 0.76, 0.0, 0.0, 0.0, 1.0])
FINGERS = ("left", "right")
BOTH = [Contact(finger, "cup") for finger in FINGERS]
NOWHERE = [Contact("palm", "upper board")]
GRASP = Scenario().grasp


@dataclass
class Fingers:
    """A gripper that remembers what it was told."""

    links = FINGERS
    told: list[str] = field(default_factory=list)

    def close(self, force: float, speed: float) -> None:
        self.told.append("close")

    def open(self, force: float, speed: float) -> None:
        self.told.append("open")


@dataclass
class Asking:
    """A motion that asks for what the test says."""

    event: str | None = None
    done: bool = False
    moved: list[list[float]] = field(default_factory=list)
    begun: int = 0

    def follow_cup(self, offset: np.ndarray) -> None:
        self.moved.append(offset.tolist())

    def take_again(self) -> None:
        self.begun += 1


@dataclass
class Bench:
    """A cup that is handled, period by period."""

    place: tuple[float, float] | None = (0.6, 0.1)
    reachable: bool = True
    cup: np.ndarray = field(default_factory=lambda: CUP)
    contacts: list[Contact] = field(default_factory=list)
    now: float = 0.0

    def __post_init__(self) -> None:
        self.fingers, self.motion = Fingers(), Asking()
        bind = {"1": "cup", **({} if self.place is None else {"2": "place"})}
        place = None if self.place is None else {"position": self.place}
        scenario = Scenario(scene={"kind": "shelf"}, bind=bind, place=place)
        self.task = Handling(scenario, self.fingers, self.motion, self.cup, lambda _: self.reachable)

    def pass_time(self, seconds: float) -> Verdict | None:
        for _ in range(math.ceil(seconds / PERIOD) + 1):
            verdict = self.task.verdict(self.now, self.cup, self.contacts)
            if verdict is not None:
                return verdict
            self.task.proceed(self.now, 0.0)
            self.now += PERIOD
        return None

    def take(self) -> None:
        self.contacts, self.motion.event = BOTH, "close"
        assert self.pass_time(GRASP.close_time) is None
        self.motion.event = None
        assert self.pass_time(2 * PERIOD) is None
        assert self.task.phase == "carry"

    def let_go(self, x: float, y: float, z: float = 0.76) -> Verdict | None:
        """Let the cup go where its middle is then; the chain is over."""
        return self.open(np.array([x, y, z, 0.0, 0.0, 0.0, 1.0]))

    def open(self, cup: np.ndarray) -> Verdict | None:
        """Open the fingers, after which the cup has another pose."""
        self.motion.event = "open"
        assert self.pass_time(PERIOD) is None
        self.cup, self.contacts = cup, []
        assert self.pass_time(GRASP.open_time) is None
        self.motion.event, self.motion.done = None, True
        return self.pass_time(2 * STANDS)


def phase(bench: Bench) -> str:
    """Return the present phase; a type checker takes an attribute for unchanged."""
    return bench.task.phase


def test_the_chain_waits_for_the_fingers_as_long_as_they_take() -> None:
    bench = Bench()
    bench.motion.event, bench.contacts = "close", BOTH
    bench.task.proceed(1.0, 0.0)
    assert (bench.fingers.told, bench.task.busy, bench.task.phase) == (["close"], True, "close")
    bench.task.proceed(1.0 + GRASP.close_time - 1e-9, 0.0)
    assert bench.task.busy
    bench.task.proceed(1.0 + GRASP.close_time, 0.0)
    assert not bench.task.busy
    assert bench.fingers.told == ["close"]  # once


def test_other_words_are_no_business_of_the_fingers() -> None:
    bench = Bench()
    for event in ("wait 0.5", "flash"):
        bench.motion.event = event
        bench.task.proceed(1.0, 0.0)
        assert (bench.fingers.told, bench.task.busy, bench.task.phase) == ([], False, "approach")


def test_a_cup_that_stands_at_its_place_a_second_after_it_was_let_go_is_placed() -> None:
    bench = Bench()
    bench.take()
    assert bench.let_go(0.61, 0.11) == Verdict("placed")  # √2 cm away
    opened = bench.task.began
    assert STANDS <= bench.now - opened <= STANDS + 2 * PERIOD


@pytest.mark.parametrize(
    ("x", "y", "z", "outcome", "words"),
    [
        (0.61, 0.12, 0.76, "misplaced", "22 mm from its place"),
        (0.6, 0.1, 0.48, "misplaced", "-280 mm above"),
        (0.6, 0.1, 0.78, "misplaced", "20 mm above"),
    ],
)
def test_a_cup_that_stands_elsewhere_is_misplaced(
    x: float, y: float, z: float, outcome: str, words: str
) -> None:
    bench = Bench()
    bench.take()
    verdict = bench.let_go(x, y, z)
    assert verdict is not None
    assert verdict.outcome == outcome
    assert words in verdict.detail


def test_a_cup_that_falls_over_after_it_was_let_go_has_tipped() -> None:
    bench = Bench()
    bench.take()
    lying = np.array([0.6, 0.1, 0.73, 0.7, 0.0, 0.0, 0.7])
    assert bench.open(lying) == Verdict("tipped", "the cup fell over after it was let go")


def test_a_chain_that_ends_with_the_cup_in_the_hand_has_grasped_it() -> None:
    bench = Bench(place=None)
    bench.take()
    bench.motion.done = True
    assert bench.pass_time(2 * GRASP.hold_time) == Verdict("grasped")


def test_a_lost_cup_that_stands_in_reach_is_taken_again_where_it_stands() -> None:
    bench = Bench()
    bench.take()
    bench.contacts, bench.cup = [], CUP + [0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]  # noqa: RUF005
    assert bench.pass_time(0.2) is None
    assert phase(bench) == "lost"
    assert bench.fingers.told == ["close", "open"]
    assert bench.task.velocity(bench.now, np.zeros(3)) == pytest.approx([0, 0, 0], abs=0)  # the hand stops
    assert bench.motion.begun == 0
    assert bench.pass_time(GRASP.open_time) is None
    assert phase(bench) == "approach"
    assert bench.motion.begun == 1
    assert bench.motion.moved == [pytest.approx([0.05, 0.0, 0.0], abs=1e-15)]  # of one rounding of 0.67
    assert bench.task.velocity(bench.now, np.zeros(3)) is None
    bench.take()
    assert bench.let_go(0.6, 0.1) == Verdict("placed")
    assert (bench.task.lost, bench.task.stood, bench.task.closed) == (1, 1, 2)


def test_a_cup_that_is_lost_just_before_the_hand_lets_it_go_is_taken_again() -> None:
    bench = Bench()
    bench.take()
    bench.contacts, bench.motion.event = [], "open"
    assert bench.pass_time(2 * PERIOD) is None
    assert bench.task.phase == "lost"


def test_contacts_may_flicker() -> None:
    bench = Bench()
    bench.take()
    bench.contacts = []
    bench.pass_time(0.05)
    bench.contacts = BOTH
    bench.pass_time(0.5)
    assert bench.task.phase == "carry"


@pytest.mark.parametrize("reachable", [False, True])
def test_a_lost_cup_that_lies_or_is_out_of_reach_is_dropped(reachable: bool) -> None:
    bench = Bench(reachable=reachable)
    bench.take()
    turn = [0.7, 0.0, 0.0, 0.7] if reachable else [0.0, 0.0, 0.0, 1.0]
    bench.contacts, bench.cup = [], np.array([0.6, 0.0, 0.45, *turn])
    verdict = bench.pass_time(2.0)
    assert verdict == Verdict("dropped", "the cup left the hand and does not stand in reach")
    assert (bench.task.lost, bench.task.stood) == (1, 0)


def test_a_cup_is_not_taken_for_ever() -> None:
    bench = Bench()
    for _ in range(TRIES - 1):
        bench.take()
        bench.contacts = []
        assert bench.pass_time(1.0) is None
    bench.take()
    bench.contacts = []
    assert bench.pass_time(1.0) == Verdict("dropped", f"the cup left the hand {TRIES} times")


def test_fingers_that_close_beside_the_cup_try_again_and_miss_it_in_the_end() -> None:
    bench = Bench()
    for _ in range(TRIES):
        bench.motion.event = "close"
        bench.pass_time(GRASP.close_time)
        bench.motion.event = None
        verdict = bench.pass_time(1.0)
    assert verdict is not None
    assert verdict.outcome == "missed"
    assert "no finger touched the cup" in verdict.detail


def test_the_arm_is_told_of_the_cup_while_it_is_in_the_hand() -> None:
    bench = Bench()
    assert bench.task.load == 0
    bench.take()
    assert bench.task.load == pytest.approx(0.1 * 9.81, rel=1e-15)
    bench.let_go(0.6, 0.1)
    assert bench.task.load == 0


def test_a_cup_that_falls_over_before_it_is_taken_has_tipped() -> None:
    bench = Bench()
    bench.cup = np.array([0.62, 0.0, 0.73, 0.7, 0.0, 0.0, 0.7])
    verdict = bench.pass_time(0.1)
    assert verdict is not None
    assert verdict.outcome == "tipped"


# A table, and hands that move straight: in front of the cup, to it, back and up, beside, down, and back.
HEIGHT = 0.48  # of the cup's middle [m]
STAGES = ((0.6, 0.0, HEIGHT), (0.44, 0.0, 0.52), (0.44, 0.15, 0.5), (0.6, 0.15, 0.485), (0.44, 0.15, 0.485))


def carried(linear: MakeLinear, **changes: Any) -> Episode:
    """Return an episode in which a chain of straight motions takes a cup on a table and sets it down."""
    chain = ChainedSkill(
        parts=tuple(linear(target) for target in STAGES),
        levels=np.array([0.004, 0.02, 0.02, 0.004, 0.02]) ** 2,  # of V = ‖offset‖², [m²]
        events=(("close",), (), (), ("open",), ()),
    )
    defaults: dict[str, Any] = {
        "start": (0.44, 0.0, HEIGHT),
        "scene": {"kind": "table"},
        "cup": {"position": (0.6, 0.0)},
        "place": {"position": (0.6, 0.15)},
        "bind": {"1": "cup", "4": "place"},
        "avoid": False,
    }
    return simulate(chain, Scenario(**{**defaults, **changes}))


def test_a_cup_is_carried_to_its_place(linear: MakeLinear) -> None:
    episode = carried(linear)
    assert (episode.outcome, episode.detail) == ("placed", "")
    assert episode.series.cups[-1, :3] == pytest.approx(
        [0.6, 0.15, HEIGHT], abs=0.02
    )  # what counts as placed
    assert episode.metrics.cup_off == pytest.approx(
        math.dist(episode.series.cups[-1, :2], (0.6, 0.15)), rel=1e-9
    )
    assert (episode.metrics.cup_lost, episode.metrics.cup_tries) == (0, 1)
    acted = episode.series.parts[np.flatnonzero(np.diff(episode.series.parts)) + 1].tolist()
    assert acted == [1, 2, 3, 4]


def test_a_cup_that_is_moved_or_knocked_out_of_the_hand_is_carried_to_its_place(linear: MakeLinear) -> None:
    moved = {"kind": "move-target", "time": 0.2, "offset": (-0.03, 0.03, 0.0)}
    knocked = {"kind": "knock", "time": 0.1, "offset": (0.05, 0.0, 0.0)}
    episode = carried(linear, disturbances=(moved, knocked))
    assert (episode.outcome, episode.detail) == ("placed", "")
    metrics = episode.metrics
    assert (metrics.cup_lost, metrics.cup_stood, metrics.cup_tries) == (1, 1, 2)


def test_a_cup_that_is_knocked_to_the_floor_is_dropped(linear: MakeLinear) -> None:
    knocked = {"kind": "knock", "time": 1.0, "offset": (-0.2, 0.0, 0.0)}
    assert carried(linear, disturbances=(knocked,)).outcome == "dropped"


def test_a_compliant_arm_that_is_told_of_the_cup_carries_it_to_its_place(linear: MakeLinear) -> None:
    episode = carried(linear, control="torque", posture="follow")
    assert (episode.outcome, episode.detail) == ("placed", "")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bind": {"6": "cup"}}, "stages 1 to 5"),
        ({"bind": {"cup": "cup"}}, "stages 1 to 5"),
        ({"target": "cup"}, "a chain has one for each stage"),
        (
            {
                "bind": {"4": "place"},
                "disturbances": ({"kind": "move-target", "time": 1.0, "offset": (0, 0, 0.1)},),
            },
            "no stage of the chain is bound to the cup",
        ),
    ],
)
def test_what_does_not_fit_a_chain_is_refused(
    linear: MakeLinear, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        carried(linear, **changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bind": {"1": "home"}}, "bind: only a chain"),
        ({"place": {"position": (0.6, 0.1)}, "cup": {}}, "place: only a chain"),
        (
            {"cup": {}, "disturbances": ({"kind": "knock", "time": 1.0, "offset": (0.1, 0.0, 0.0)},)},
            "knock: only",
        ),
    ],
)
def test_what_only_a_chain_does_is_refused_of_another_skill(
    linear: MakeLinear, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        simulate(linear((0.6, 0.0, HEIGHT)), Scenario(scene={"kind": "table"}, **changes))


def test_a_chain_that_carries_nothing_is_over_at_its_last_target(linear: MakeLinear) -> None:
    targets = ((0.5, 0.1, 0.5), (0.5, -0.1, 0.5))
    chain = ChainedSkill(
        parts=tuple(map(linear, targets)), levels=np.full(2, 0.01**2), events=(("wait 0.8",), ("close",))
    )
    episode = simulate(chain, Scenario(start=(0.45, 0.0, 0.5), bind={"2": (0.5, -0.15, 0.5)}))
    assert episode.outcome == "reached"
    assert episode.target == pytest.approx([0.5, -0.15, 0.5], abs=1e-9)
    # It waits longer at the first target than a hand has to stay to count as arrived, and is not over there.
    waited = episode.series.times[np.flatnonzero(episode.series.parts == 1)[0]]
    near = np.linalg.norm(episode.series.hand - targets[0], axis=1) < 0.01
    assert waited - episode.series.times[near][0] >= 0.8
