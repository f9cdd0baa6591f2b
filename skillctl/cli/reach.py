"""``skillctl simulate --check``: its report for people."""

from __future__ import annotations

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
    for name, point, residual in (
        ("start", found.start, found.start_residual),
        ("target", found.target, found.target_residual),
    ):
        if point is not None and residual is not None:
            off = f", {words.length(residual, 'm')} off" if found.unit == "m" else ""
            facts.append((name, f"{words.point(point, found.unit)}{off}"))
    if found.path_residual is not None and found.duration is not None:
        facts.append(
            ("path", f"{words.length(found.path_residual, 'm')} off at most, {found.duration:.2f} s long")
        )
    if found.joint_margin is not None:
        facts.append(
            ("joint margin", f"{found.joint_margin:.2f} rad to a limit of joint {found.tightest_joint}")
        )
    if found.velocity_ratio is not None:
        slowed = "; the arm will slow it down" if found.velocity_ratio > 1 else ""
        facts.append(("joint speed", f"{found.velocity_ratio:.0%} of the limit at most{slowed}"))
    if found.torque_ratio is not None:
        facts.append(("joint torque", f"{found.torque_ratio:.0%} of the limit at most, to carry the arm"))
    return [render.Facts(tuple(facts))]
