"""A skill on a robot: proved first, then led step by step, with a log of everything."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from skillctl import __version__
from skillctl.drivers.driver import Driver, Setup
from skillctl.drivers.log import Recorded, encode, read_log
from skillctl.drivers.loop import DueEvent, Ending, Loop, Outcome, heeded
from skillctl.drivers.measures import Place, Timing, largest_difference, place_of, timing_of
from skillctl.drivers.options import RunOptions
from skillctl.drivers.registry import driver_class
from skillctl.drivers.replay import Replay
from skillctl.drivers.start import start_of
from skillctl.errors import GoalNotReachedError, UsageError, require_directory
from skillctl.options import options_of
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate, at_least
from skillctl.store import Lock, write_file
from skillctl.store.source import Source, open_skill

UNPROVED = "Add --allow-unproved to run it all the same."


@dataclass(frozen=True)
class RunReport:
    """The result of a run on a robot.

    Attributes:
        skill, digest: The skill that was run.
        driver: The driver and its address, or ``dry run``.
        outcome: How the run ended: ``arrived`` or why it did not.
        success: Whether the hand has arrived; of a chain, whether all stages and events are over.
        detail: What happened, if it has not.
        duration: Time of the motion, until the hand rests, [s].
        period: Time between two commands, as intended, [s].
        longest: Δt_max, the longest period that is proved, [s]; null if none is.
        timing: How well the period was kept.
        start: The first measured state, as ``--start`` takes it.
        place: Where the hand was in the end, and how far from the target.
        unit: Unit of the distance: ``m``, or ``rad`` of joints.
        events: What a chain asked for.
        difference: Of a dry run: how far commands are at most from those in the log, per second; null if the
            log has none.
        log: The log, if one was written.
        notes: What was said before the motion.
    """

    skill: str
    digest: str
    driver: str
    outcome: Outcome
    success: bool
    detail: str
    duration: float
    period: float
    longest: float | None
    timing: Timing
    start: tuple[float, ...]
    place: Place
    unit: str
    events: tuple[DueEvent, ...]
    difference: float | None
    log: Path | None
    notes: tuple[str, ...]


def run(
    reference: str | Path,
    options: RunOptions | None = None,
    *,
    store: str | Path | None = None,
    lock: Lock | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
) -> RunReport:
    """Run a skill on a robot until the hand has arrived, or until something forbids to go on.

    SIGINT and SIGTERM end the run smoothly, a second one ends it at once. In any case the log is whole.

    Args:
        reference: The skill.
        options: Robot, limits, and what ends the motion.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.
        tell: Called with what somebody should read before the robot moves, in sentences.

    Raises:
        NotFoundError: No such skill, driver or library, or no robot.
        GoalNotReachedError: The skill is not proved, or start or target is outside the box.
        UsageError: A longer period than is proved, or a skill that is not for this robot.
        InputDataError: The first state cannot be used, or the log of a dry run.
    """
    options = options or RunOptions()
    require_directory(options.log)
    source = open_skill(reference, store, lock)
    skill, certificate = source.skill, certify(source.skill, digest=source.artifact.digest)
    if certificate.verdict != "stable" and not options.allow_unproved:
        raise GoalNotReachedError(f"{source.name} is not proved stable, so nothing moves.", hint=UNPROVED)
    recorded = None if options.dry_run is None else read_log(options.dry_run, skill.space)
    with closing(_robot(source, options, recorded)) as driver:
        if not options.allow_unproved:
            _require_period(source.name, driver.period, certificate)
        loop = Loop(driver, skill, options)
        start = loop.connect()
        notes = tuple(_notes(driver, source))
        for note in notes:
            tell(note)
        ending = Ending("fault", "the run was broken off")
        with heeded() as stopped:
            try:
                ending = loop.drive(stopped)
            finally:
                if options.log is not None:
                    about = _about(source, certificate, options, driver.period, loop, ending)
                    write_file(options.log, encode(loop.rows, about))
    rows = loop.rows
    return RunReport(
        skill=source.name,
        digest=source.artifact.digest,
        driver=options.driver if recorded is None else "dry run",
        outcome=ending.outcome,
        success=ending.outcome == "arrived",
        detail=ending.detail,
        duration=float(rows.t[-1]) if len(rows.t) else 0.0,
        period=driver.period,
        longest=certificate.period,
        timing=timing_of(rows, driver.period, certificate.period),
        start=skill.space.given(start),
        place=place_of(skill, loop.state),
        unit=skill.space.unit,
        events=tuple(loop.events),
        difference=None if recorded is None else largest_difference(rows, recorded),
        log=options.log,
        notes=notes,
    )


def _robot(source: Source, options: RunOptions, recorded: Recorded | None) -> Driver:
    """Return the driver, connected; that of a dry run for what was recorded."""
    name, _, address = options.driver.partition(":")
    start = start_of(source.skill, source.artifact.demonstrations, options.start)
    setup = Setup(address, source.skill, options.period, options.max_acceleration, start)
    return driver_class(name)(setup) if recorded is None else Replay(setup, recorded)


def _require_period(name: str, period: float, certificate: Certificate) -> None:
    """Raise UsageError for a period beyond the proved one."""
    longest = certificate.period
    if longest is None or period > longest:
        proved = "none is" if longest is None else f"at most {at_least(longest)} s is"
        raise UsageError(
            f"period: {period:g} s is too long: {proved} proved for {name}.",
            hint=f"Give a shorter --period, or learn it with a longer one. {UNPROVED}",
        )


def _notes(driver: Driver, source: Source) -> Iterator[str]:
    """Yield what somebody should read before the robot moves."""
    if driver.untried:
        yield (
            f"this driver was tried on {driver.untried}, not on hardware; keep a hand at the emergency stop, "
            "and begin with a small --speed."
        )
    if any(getattr(source.skill, "events", ())) and not driver.grips:
        yield "this driver has no gripper: what the chain asks for is only written into the log."


def _about(
    source: Source,
    certificate: Certificate,
    options: RunOptions,
    period: float,
    loop: Loop,
    ending: Ending,
) -> dict[str, Any]:
    """Return what a log says besides its rows: all that the commands were made of."""
    space = source.skill.space
    return {
        "skill": source.name,
        "digest": source.artifact.digest,
        "certificate": asdict(certificate),
        "names": space.names,
        "units": space.units,
        "frame": space.frame,
        "period": period,
        "options": {each.key: str(getattr(options, each.field)) for each in options_of(RunOptions)},
        "versions": {
            "skillctl": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in ("numpy", "h5py")},
        },
        "machine": platform.platform(),
        **asdict(ending),
        "events": [asdict(event) for event in loop.events],
    }
