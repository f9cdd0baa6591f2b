"""Faults of recordings, and what follows from them: a warning, or a refusal unless the user accepts them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skillctl.demonstrations.options import Fault as Kind
from skillctl.errors import InputDataError
from skillctl.options import written_ranges

# Shares of the extent, the samples or the duration: what is a warning, and what is refused.
NOTICED, REFUSED = 0.1, 0.25
MOST = 3  # sentences about faults of one kind


@dataclass(frozen=True, slots=True)
class Fault:
    """What is wrong with recordings, and whether that is too much.

    Attributes:
        kind: The word with which ``--accept`` accepts it.
        refused: Whether it has to be accepted.
        sentence: What is wrong, with file and place.
        demo: Demonstration that has it, counted from 0 over all files; None if all together have it.
    """

    kind: Kind
    refused: bool
    sentence: str
    demo: int | None = 0


def require_accepted(faults: Sequence[Fault], accepted: Sequence[Kind], chosen: Sequence[int]) -> None:
    """Raise unless the faults that are refused are all of accepted kinds.

    Args:
        faults: Found in the demonstrations.
        accepted: Kinds that the user accepts.
        chosen: The demonstrations that were read, counted from 0 over all files.

    Raises:
        InputDataError: The message tells the first of them; the hint says how to leave out all demonstrations
            that have one, and how to accept them.
    """
    refused = [fault for fault in faults if fault.refused and fault.kind not in accepted]
    if not refused:
        return
    what, more = ("it", "") if len(refused) == 1 else ("all", f" {len(refused)} faults are too large.")
    kinds = ",".join(dict.fromkeys(fault.kind for fault in refused))
    good = [demo for demo in chosen if demo not in {fault.demo for fault in refused}]
    possible = good and all(fault.demo is not None for fault in refused)
    leave = f"Leave {what} out with --demos {written_ranges(good)}, or a" if possible else "A"
    raise InputDataError(f"{refused[0].sentence}{more}", hint=f"{leave}ccept {what} with --accept {kinds}.")


def told(faults: Sequence[Fault]) -> tuple[str, ...]:
    """Return the sentences of faults, the first few of each kind."""
    by_kind: dict[Kind, list[str]] = {}
    for fault in faults:
        by_kind.setdefault(fault.kind, []).append(fault.sentence)
    return tuple(
        sentence
        for kind, sentences in by_kind.items()
        for sentence in (
            *sentences[:MOST],
            *([f"{len(sentences) - MOST} more demonstrations with {kind}."] if len(sentences) > MOST else []),
        )
    )
