"""Which bodies of a scene a hand provably never meets. Of the rest of the arm nothing is said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillctl.model.coordinates.bodies import Body
from skillctl.model.coordinates.chain import OnPosition
from skillctl.model.coordinates.keep_out import KeepOut
from skillctl.model.skill import Skill
from skillctl.stability.reach import Reach


@dataclass(frozen=True, slots=True)
class Clearance:
    """What is proved of a hand among bodies, as the point that the skill moves sees them.

    Attributes:
        clear: Of these bodies it is proved clear.
        may_meet: These it may meet: nothing is proved.
        proof: What that rests on, in sentences.
    """

    clear: tuple[str, ...]
    may_meet: tuple[str, ...]
    proof: tuple[str, ...]


def clearance(
    skill: Skill, avoided: Sequence[Body], others: Sequence[tuple[Body, str]], reach: Reach | None
) -> Clearance:
    """Return of which bodies a hand is proved clear.

    Args:
        skill: In coordinates that keep out of ``avoided``; see ``kept_out``.
        avoided: Bodies that motions go round, from every start outside.
        others: Bodies that they do not go round, with reasons.
        reach: How far motions from a start box go; None if that is not known.
    """
    kept = [leaf.coordinates.links[0] for leaf in skill.leaves if leaf.coordinates.links]
    maps = [link.link if isinstance(link, OnPosition) else link for link in kept]
    exact = len(maps) == len(skill.leaves) and all(
        isinstance(each, KeepOut) and not each.check() for each in maps
    )
    round_them = _names(avoided if exact else [])
    beyond = [body for body, _ in others if reach is not None and _beyond(body, reach)]
    missed = _names(beyond)
    left = [(body.name, why) for body, why in others if body not in beyond]
    may_meet = tuple(dict.fromkeys(name for name, _ in left if name not in round_them))
    proof = ["The hand is the box around it, turned as at the target; the rest of the arm is not looked at."]
    if round_them:
        proof.append(
            f"Of {', '.join(round_them)}: from every start outside, if the controller keeps out of them, as "
            "`simulate` does, and the robot follows it."
        )
    if missed:
        proof.append(f"Of {', '.join(missed)}: motions from the start box never come there.")
    proof += [f"May meet {name}: {why}." for name, why in dict(left).items() if name in may_meet]
    return Clearance(tuple(dict.fromkeys((*round_them, *missed))), may_meet, tuple(proof))


def _names(bodies: Sequence[Body]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(body.name for body in bodies))


def _beyond(body: Body, reach: Reach) -> bool:
    """Return whether the box that motions stay in lies beside the box around a body."""
    low, high = body.bounds
    d = len(low)
    return bool((low > np.array(reach.high[:d])).any() or (high < np.array(reach.low[:d])).any())
