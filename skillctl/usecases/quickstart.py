"""Every step on an example: demonstrations, skills, skills from skills, proofs, a simulated arm, a cup."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from skillctl.compose.options import ChainOptions, CombineOptions, MergeOptions, read_within
from skillctl.demonstrations.options import Reading
from skillctl.demonstrations.reaching import TASKS, reaching_demonstrations, target_of
from skillctl.demonstrations.writing import write_csv
from skillctl.errors import NotFoundError, UsageError
from skillctl.evaluate.errors import mean_dtw
from skillctl.progress import Progress
from skillctl.simulation.scenario import Scenario
from skillctl.simulation.scenario_file import overridden, read_scenario
from skillctl.stability.report import Verdict
from skillctl.usecases.chain import chain
from skillctl.usecases.combine import combine
from skillctl.usecases.learn import learn
from skillctl.usecases.make import MakeReport
from skillctl.usecases.merge import merge
from skillctl.usecases.simulate import simulate
from skillctl.usecases.simulate_many import simulate_many
from skillctl.usecases.verify_stability import verify

DEMONSTRATIONS, STORE, PICTURE = Path("demonstrations"), Path("skills"), Path("shelf.png")
CUPS = Path("cups.toml")
MERGED = {"top-left": ("bottom-left", "top-centre"), "top-right": ("bottom-right", "top-centre")}
SHELF = "shelf"
COMBINED = ("bottom-left", "bottom-right", "top-centre")
LEAVE, LEFT = "leave", "bottom-right"  # a retreat, and the approaches that it is learned from backwards
CARRY, STAGES = "carry", (SHELF, LEAVE, "top-centre", LEAVE)
TAKEN, EVENTS, WITHIN = (1, (0.63, 0.0, 0.48)), ((1, "close"), (3, "open")), "5mm"
BOUND = {"1": "cup", "2": "home", "3": "place", "4": "home"}
START = (0.42, 0.0, 0.55)  # low in front of the shelf, where the demonstrations start [m]
CUP, PLACE = (0.62, -0.2), (0.62, 0.0)  # on the lower and the upper board; no demonstration went there [m]
COMPARED = (*TASKS, SHELF)  # on the same cups
EPISODES = 8
ANYWHERE = """\
# A cup anywhere on one of the two boards, and a start of the hand as in the demonstrations.
target = "cup"

[scene]
kind = "shelf"

[grasp]
lift = 0.06  # higher, and the forearm would meet the upper board

[sampling]
boards = ["bottom", "top"]
cup_x_range = [0.55, 0.68]
cup_y_range = [-0.42, 0.42]
start_x_range = [0.385, 0.44]
start_y_range = [-0.2, 0.2]
start_z_range = [0.5, 0.58]
"""

Announce = Callable[[str], None]


@dataclass(frozen=True)
class SkillSummary:
    """One skill of the example.

    Attributes:
        skill: Its name and version.
        made_by: ``learn``, ``merge``, ``combine`` or ``chain``.
        dtw: Mean distance of its motion to its demonstrations, [m]; None unless learned from some.
        verdict, rate, period: What is proved: verdict, decay rate [1/s], longest controller period [s].
        outcome: Of the simulated reach; None if there is no simulator, or none was tried.
        final_error, time_to_target: Of that reach, [m] and [s].
        grasped: How many of the same cups it grasped; None if that was not tried.
    """

    skill: str
    made_by: str
    dtw: float | None
    verdict: Verdict
    rate: float | None
    period: float | None
    outcome: str | None = None
    final_error: float | None = None
    time_to_target: float | None = None
    grasped: int | None = None


@dataclass(frozen=True)
class QuickstartReport:
    """What ``quickstart`` did.

    Attributes:
        directory: Where everything is.
        commands: What was run; the same can be typed in that directory.
        skills: One summary a skill.
        cups: How many cups ``grasped`` is counted of.
        outcome: Of the cup that the chain carries at the end; None if there is no simulator.
        picture: Of that.
        notes: What was left out, and why.
    """

    directory: Path
    commands: tuple[str, ...]
    skills: tuple[SkillSummary, ...]
    cups: int
    outcome: str | None
    picture: Path | None
    notes: tuple[str, ...]

    @property
    def success(self) -> bool:
        """Whether everything was proved, every simulated reach arrived, and the cup was set down."""
        proved = all(skill.verdict == "stable" for skill in self.skills)
        arrived = all(skill.outcome in (None, "reached") for skill in self.skills)
        return proved and arrived and self.outcome in (None, "placed")


def quickstart(
    directory: Path, *, announce: Announce = lambda _: None, progress: Progress | None = None
) -> QuickstartReport:
    """Write example demonstrations; learn, merge, combine, chain, verify and simulate skills from them.

    In a directory that holds an earlier quickstart, what is up to date is left as it is.

    Args:
        directory: Where to do all this; made if need be.
        announce: Called with each command before it is run.
        progress: Called with (stage, done, total) within the longer ones.

    Raises:
        UsageError: The directory holds other things.
        StoreError: It cannot be written.
    """
    _require_free(directory)
    directory.mkdir(parents=True, exist_ok=True)
    with _working_in(directory):
        session = _Session(announce, progress)
        session.say("cd", shlex.quote(str(directory)))
        session.learn_all()
        session.merge_and_combine()
        session.chain()
        session.verify_all()
        outcome = session.simulate_all()
    commands, skills = tuple(session.commands), tuple(session.skills.values())
    picture = None if outcome is None else directory / PICTURE
    return QuickstartReport(directory, commands, skills, EPISODES, outcome, picture, tuple(session.notes))


@dataclass(eq=False)
class _Session:
    """Runs the commands one after the other; what is announced is what is run."""

    announce: Announce
    progress: Progress | None
    commands: list[str] = field(default_factory=list)
    skills: dict[str, SkillSummary] = field(default_factory=dict)  # by name
    notes: list[str] = field(default_factory=list)

    def say(self, *words: str) -> None:
        self.commands.append(" ".join(words))
        self.announce(self.commands[-1])

    def made(self, name: str, command: str, report: MakeReport, dtw: float | None = None) -> None:
        proved = report.certificate
        self.skills[name] = SkillSummary(
            report.written.skill, command, dtw, proved.verdict, proved.rate, proved.period
        )

    def learn_all(self) -> None:
        for task in TASKS:
            (folder := DEMONSTRATIONS / task).mkdir(parents=True, exist_ok=True)
            for number, demonstration in enumerate(reaching_demonstrations(task), start=1):
                write_csv(demonstration, folder / f"{number}.csv")
            self.say("skillctl learn", f"{DEMONSTRATIONS}/{task}/*.csv", "--name", task)
            report = learn(sorted(folder.glob("*.csv")), name=task, store=STORE, progress=self.progress)
            self.made(task, "learn", report, mean_dtw(report.demonstrations))

    def merge_and_combine(self) -> None:
        for name, parts in MERGED.items():
            target = tuple(target_of(name).tolist())
            self.say("skillctl merge", *parts, "--target", _typed(target), "--name", name)
            options = MergeOptions(target=target)
            merged = merge(parts, name=name, store=STORE, options=options, progress=self.progress)
            self.made(name, "merge", merged)
        target = tuple(target_of("top-centre").tolist())
        self.say("skillctl combine", *COMBINED, "--align", "--target", _typed(target), "--name", SHELF)
        combining = CombineOptions(align=True, target=target)
        self.made(SHELF, "combine", combine(COMBINED, name=SHELF, store=STORE, options=combining))

    def chain(self) -> None:
        files, reading = f"{DEMONSTRATIONS}/{LEFT}/*.csv", Reading(reverse=True, accept=("ends",))
        self.say("skillctl learn", files, "--reverse --accept ends", "--name", LEAVE)
        paths = sorted((DEMONSTRATIONS / LEFT).glob("*.csv"))
        report = learn(paths, name=LEAVE, store=STORE, reading=reading, progress=self.progress)
        self.made(LEAVE, "learn", report, mean_dtw(report.demonstrations))
        stage, target = TAKEN
        events = [word for number, event in EVENTS for word in ("--event", f"{number}:{event}")]
        placed = ("--target", f"{stage}={_typed(target)}", "--within", WITHIN)
        self.say("skillctl chain", *STAGES, *placed, *events, "--name", CARRY)
        options = ChainOptions(target=(TAKEN,), within=(read_within(WITHIN),), event=EVENTS)
        self.made(CARRY, "chain", chain(STAGES, name=CARRY, store=STORE, options=options))

    def verify_all(self) -> None:
        self.say("skillctl verify-stability", *self.skills)
        for name in self.skills:
            proved = verify(name, store=STORE)
            self.update(name, verdict=proved.verdict, rate=proved.rate, period=proved.period)

    def simulate_all(self) -> str | None:
        """Return how the last grasp ended; None without a simulator, when everything else still stands."""
        CUPS.write_text(ANYWHERE, encoding="utf-8")
        try:
            for name in (*TASKS, *MERGED, SHELF):
                self.reach(name)
            for name in COMPARED:
                self.grasp_many(name)
            return self.carry()
        except NotFoundError as error:
            self.commands.pop()
            self.notes.append(f"nothing was simulated: {error} {error.hint}".strip())
            return None

    def reach(self, name: str) -> None:
        self.say("skillctl simulate", name, "--start", _typed(START))
        run = simulate(name, Scenario(start=START), store=STORE, progress=self.progress)
        off, time = run.metrics.final_error, run.metrics.time_to_target
        self.update(name, outcome=run.outcome, final_error=off, time_to_target=time)

    def grasp_many(self, name: str) -> None:
        options = ("--scenario", str(CUPS), "--episodes", str(EPISODES), "--min-success", "0")
        self.say("skillctl simulate", name, *options)
        scenario = read_scenario(CUPS).changed(episodes=EPISODES)
        run = simulate_many(name, scenario, min_success=0.0, store=STORE, progress=self.progress)
        self.update(name, grasped=run.successes)

    def carry(self) -> str:
        bound = [word for stage, name in BOUND.items() for word in ("--bind", f"{stage}={name}")]
        places = ("--cup", f"{_typed(CUP)},bottom", "--place", f"{_typed(PLACE)},top")
        self.say("skillctl simulate", CARRY, "--scene shelf", *places, *bound, "--picture", str(PICTURE))
        standing = {"cup": {"position": CUP, "board": "bottom"}, "place": {"position": PLACE, "board": "top"}}
        scenario = overridden(Scenario(), {"scene": "shelf", "bind": BOUND, **standing})
        return simulate(CARRY, scenario, picture=PICTURE, store=STORE, progress=self.progress).outcome

    def update(self, name: str, **found: Any) -> None:
        self.skills[name] = replace(self.skills[name], **found)


def _typed(values: tuple[float, ...]) -> str:
    """Return coordinates as one types them; they read back as the same numbers."""
    return ",".join(f"{value:g}" for value in values)


def _require_free(directory: Path) -> None:
    """Raise UsageError unless the directory is missing, empty, or holds an earlier quickstart alone."""
    if not directory.exists():
        return
    problem = "" if directory.is_dir() else "is not a directory"
    ours = {str(path) for path in (DEMONSTRATIONS, STORE, CUPS, PICTURE)}
    if not problem and (foreign := {entry.name for entry in directory.iterdir()} - ours):
        problem = f"is not empty: it holds {min(foreign)}"
    if problem:
        raise UsageError(f"{directory} {problem}.", hint="Name a new directory: skillctl quickstart DIR")


@contextmanager
def _working_in(directory: Path) -> Iterator[None]:
    """Work in a directory for a while, so that paths are recorded as one types them there."""
    before = Path.cwd()
    os.chdir(directory)
    try:
        yield
    finally:
        os.chdir(before)
