"""``skillctl simulate --check``: its report for people."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skillctl.cli import render, words

if TYPE_CHECKING:
    from skillctl.usecases.check_reach import CheckReachReport


def blocks(report: CheckReachReport) -> list[render.Block]:
    """Return the report for people. Values are None, and left out, if an earlier check failed."""
    found = report.reachability
    facts = [("skill", report.skill), ("reachable", words.yes_no(found.reachable))]
    if found.reason:
        facts.append(("reason", found.reason))
    facts += words.arm(found.arm, found.hand if found.unit == "m" else None, found.tip, found.held)
    for name, point, residual, turn in (
        ("start", found.start, found.start_residual, found.start_turn),
        ("target", found.target, found.target_residual, found.target_turn),
    ):
        if point is not None and residual is not None:
            off = f", {_off(residual, turn)} off" if found.unit == "m" else ""
            shown = point if turn is None else point[:3]
            facts.append((name, f"{words.point(shown, found.unit)}{off}"))
    if found.path_residual is not None and found.duration is not None:
        off = _off(found.path_residual, found.path_turn)
        facts.append(("path", f"{off} off at most, {found.duration:.2f} s long"))
    if found.joint_margin is not None:
        facts.append(
            ("joint margin", f"{found.joint_margin:.2f} rad to a limit of joint {found.tightest_joint}")
        )
        facts.append(("manipulability", f"{words.number(found.manipulability)} at least"))
    if found.velocity_ratio is not None:
        slowed = "; the arm will slow it down" if found.velocity_ratio > 1 else ""
        facts.append(("joint speed", f"{found.velocity_ratio:.0%} of the limit at most{slowed}"))
    if found.torque_ratio is not None:
        facts.append(("joint torque", f"{found.torque_ratio:.0%} of the limit at most, to carry the arm"))
    return [render.Facts(tuple(facts))]


def _off(distance: float, turn: float | None) -> str:
    """Return how far the hand is from a place: a distance, and for a pose an angle."""
    return words.length(distance, "m") + ("" if turn is None else f" and {math.degrees(turn):.2f}°")
