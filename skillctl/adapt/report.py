"""Whether a skill does a task, clause by clause; plain data, which needs no NumPy."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ClauseVerdict:
    """Whether one clause holds.

    Attributes:
        clause: Its name.
        unit: Of the margins.
        margin: The smallest measured one over all starts; negative: it fails.
        worst_start: The start of that motion.
        proved: Whether it is proved for every start in the box, and not only measured.
        bound: The margin that is proved, negative if the bound is too wide to prove the clause; None if
            nothing can be proved of such a clause.
    """

    clause: str
    unit: str
    margin: float
    worst_start: tuple[float, ...]
    proved: bool
    bound: float | None

    @property
    def holds(self) -> bool:
        """Whether it holds on all motions, or is proved."""
        return self.margin >= 0


@dataclass(frozen=True)
class TaskVerdict:
    """Whether a skill does a task.

    Attributes:
        clauses: One verdict each.
        starts: Number of starts in the box that were drawn to judge it, or of points.
        held: From how many of them every clause holds.
        interval: Wilson's interval of that share, of 95 %.
    """

    clauses: tuple[ClauseVerdict, ...]
    starts: int
    held: int
    interval: tuple[float, float]

    @property
    def holds(self) -> bool:
        """Whether every clause holds."""
        return all(clause.holds for clause in self.clauses)

    @property
    def failures(self) -> tuple[str, ...]:
        """The clauses that fail, with their margins, in sentences."""
        return tuple(
            f"{each.clause} fails by {-each.margin:.3g} {each.unit}, from "
            f"({', '.join(f'{number:.3g}' for number in each.worst_start)})."
            for each in self.clauses
            if not each.holds
        )
