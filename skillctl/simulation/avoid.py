"""Where the hand must not be: the scene, seen from the point that a skill moves.

A thing and a hand of fixed orientation touch exactly where the hand's point is in the thing grown by the
mirrored hand (their Minkowski sum). Hand and things are taken as the boxes around them, and the hand's
orientation as the one at the target: elsewhere it is turned, and what is far from the target is kept clear of
only about. Of the rest of the arm this says nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.coordinates.bodies import Body, Box
from skillctl.model.kept_out import admitted, kept_out
from skillctl.model.skill import AnySkill, Skill
from skillctl.rotations import matrices, vectors
from skillctl.simulation.arm import CONTROL_PERIOD, ArmBody
from skillctl.simulation.arms import ArmModel
from skillctl.simulation.ik import Kinematics
from skillctl.simulation.placement import Placement
from skillctl.simulation.scenario import BoxObstacle, Cup, CylinderObstacle, Scenario
from skillctl.simulation.scene import boxes

BULLET_PADDING = 0.004  # [m], by which Bullet's boxes around meshes are larger on each side
MARGIN = 0.003  # [m] around all things, which are rounded by it
SURE = 2.0  # standard deviations
ROOM = 0.008  # [m] more around all but the cup, for which the fingers have no more room
INNER = 0.012  # [m] from the faces of what guides the fingers to its pole
LEDGE = 0.012  # [m] from the inflated board up to what guides the fingers past the cup


@dataclass(frozen=True, eq=False, slots=True)
class HandShape:
    """Boxes around the parts of a hand, in the frame of its point, (n, 3) each, [m].

    Attributes:
        low, high: Corners of all parts.
        fingers: Which of them are fingers, two or none.
        carried: The cup that stands upright in the hand. Its foot needs no more room than the margin.
    """

    low: FloatArray
    high: FloatArray
    fingers: tuple[int, ...]
    carried: Cup | None = None

    def around(self, axes: FloatArray, parts: list[int] | None = None) -> tuple[FloatArray, FloatArray]:
        """Return the corners (3,) of one box around parts of the hand, along axes (rows, (3, 3))."""
        chosen = range(len(self.low)) if parts is None else parts
        ends = np.stack([self.low, self.high])
        corners = [
            axes @ np.array([ends[i, k, 0], ends[j, k, 1], ends[m, k, 2]])
            for k in chosen
            for i, j, m in np.ndindex(2, 2, 2)
        ]
        if self.carried is not None and parts is None:
            beside, foot = self.carried.radius, 0.5 * self.carried.height - ROOM
            corners += [np.array([-beside, -beside, -foot]), np.array([beside, beside, foot])]
        return np.min(corners, axis=0), np.max(corners, axis=0)


@lru_cache(maxsize=8)
def hand_shape(model: ArmModel) -> HandShape:
    """Return the shape of what an arm carries beyond its last link; of that link if it carries nothing."""
    with ArmBody(model, 0.0, shapes="collision") as body:
        bullet, last = body.bullet, model.indices[-1]
        parents = [bullet.getJointInfo(body.body, i)[16] for i in range(bullet.getNumJoints(body.body))]
        place, turn = body.hand()
        base = bullet.getBasePositionAndOrientation(body.body)
        back = bullet.multiplyTransforms(*bullet.invertTransform(place.tolist(), turn), *base)
        bullet.resetBasePositionAndOrientation(body.body, *back)  # now the hand's frame is the world's
        shaped = [i for i in range(len(parents)) if bullet.getCollisionShapeData(body.body, i)]
        links = [i for i in shaped if _beyond(i, last, parents)] or [last]
        ends = np.array([bullet.getAABB(body.body, link) for link in links])
    moving = {joint for joint, _ in model.fingers}
    fingers = tuple(n for n, link in enumerate(links) if link in moving)
    shape = HandShape(ends[:, 0] + BULLET_PADDING, ends[:, 1] - BULLET_PADDING, fingers)
    return shape if len(fingers) == 2 else replace(shape, fingers=())


def _beyond(link: int, last: int, parents: list[int]) -> bool:
    while link > last:
        link = parents[link]
        if link == last:
            return True
    return False


@dataclass(frozen=True, eq=False, slots=True)
class Avoidance:
    """Keeps skills out of a scene.

    Attributes:
        scenario, placement: Of the run.
        shape: Of the hand.
        kinematics: Gives the hand's orientation at the target.
        starts: Where the motion is known to start, (n, d), in the skill's frame; a body there is left out.
    """

    scenario: Scenario
    placement: Placement
    shape: HandShape
    kinematics: Kinematics
    starts: FloatArray | None = None

    def applied(self, skill: AnySkill, moved: FloatArray) -> AnySkill:
        """Return a skill, moved in the workspace by ``moved`` (3,) [m], that keeps out of the scene."""
        if isinstance(skill, ChainedSkill):
            stages = zip(self._stages_of(skill), skill.parts, strict=True)
            return replace(skill, parts=tuple(stage.applied(part, moved) for stage, part in stages))
        if isinstance(skill, CombinedSkill) and self.kinematics.hand == "taught":  # parts turn it differently
            return replace(skill, parts=tuple(self.applied(part, moved) for part in skill.parts))
        bodies, _ = self.admitted(skill, moved)
        return kept_out(skill, bodies, margin=MARGIN, stride=self._stride)

    def said(self, skill: Skill) -> str:
        """Return what of the scene a skill is kept out of, and of what it is not and why, in a sentence."""
        if isinstance(skill, ChainedSkill):
            said = (stage.said(part) for stage, part in zip(self._stages_of(skill), skill.parts, strict=True))
            return " ".join(f"stage {number}: {text}" for number, text in enumerate(said, start=1))
        bodies, refusals = self.admitted(skill, np.zeros(3))
        names = ", ".join(dict.fromkeys(body.name for body in bodies)) or "nothing"
        meshes = [f"{each.name} (a mesh)" for each in self.scenario.obstacles if each.kind == "mesh"]
        sides = ["sides of the cup (it is not perceived well enough)"] if self._unsure else []
        others = ", ".join([f"{body.name} ({reason})" for body, reason in refusals] + meshes + sides)
        return f"the hand keeps out of: {names}{f'; not of: {others}' if others else ''}."

    def admitted(self, skill: Skill, moved: FloatArray) -> tuple[list[Body], tuple[tuple[Body, str], ...]]:
        """Return the bodies that a skill, moved by ``moved`` (3,), keeps out of; and others, with reasons."""
        if self.kinematics.hand == "taught":
            skill = skill.acting_parts[0]
        ends = self.placement.to_workspace(skill.attractors)
        target = ends[0]  # of a pose with its orientation
        target[:3] = ends[:, :3].mean(axis=0) + moved
        bodies = [body.translated(-self.placement.origin - moved) for body in self.bodies(target)]
        return admitted(skill, bodies, margin=MARGIN, stride=self._stride, starts=self.starts)

    def _stages_of(self, chain: ChainedSkill) -> Iterator[Avoidance]:
        """Yield what keeps each stage of a chain out: its hand may carry a cup, or go to it."""
        carried, starts = False, None
        for stage, events in enumerate(chain.events):
            seen = self.scenario.changed(target="cup" if stage in self.scenario.stages_at("cup") else None)
            shape = replace(self.shape, carried=self.scenario.cup if carried else None)
            yield replace(self, scenario=seen, shape=shape, starts=starts)
            carried = "close" in events or (carried and "open" not in events)
            starts = chain.parts[stage].attractors

    @property
    def _unsure(self) -> bool:
        """Whether the hand is perceived too badly for the few millimetres between fingers and cup."""
        shaken = SURE * math.hypot(self.scenario.noise, self.scenario.target_error)
        return self.scenario.target == "cup" and shaken > MARGIN

    @property
    def _stride(self) -> float:
        return self.scenario.max_speed * CONTROL_PERIOD

    def bodies(self, target: FloatArray) -> list[Body]:
        """Return the bodies that the hand's point must not enter on its way to a target, a place."""
        return [*self._furniture(target), *self._obstacles(target), *self._cup(target)]

    def _axes(self, target: FloatArray) -> FloatArray:
        """Return the hand's axes at a target, a place, as columns."""
        turn = self.kinematics.orientation(target)
        return np.eye(3) if turn is None else matrices(vectors(np.array(turn)))

    def _furniture(self, target: FloatArray) -> Iterator[Body]:
        low, high = self.shape.around(self._axes(target))
        for box in boxes(self.scenario.scene):
            least, most = box.lower - high - ROOM, box.upper - low + ROOM
            # Motions shall go round a board's front edge, wherever the cup is: the pole is deep behind it.
            pole = np.clip([most[0], target[1], 0.5 * (least[2] + most[2])], least, most)
            pole[0] = most[0] - min(ROOM, 0.5 * (most[0] - least[0]))
            yield Box.between(box.name, least.tolist(), most.tolist(), tuple(pole.tolist()))

    def _obstacles(self, target: FloatArray) -> Iterator[Body]:
        for obstacle in self.scenario.obstacles:
            if isinstance(obstacle, BoxObstacle):
                size = np.array(obstacle.size)
            elif isinstance(obstacle, CylinderObstacle):
                size = np.array([2 * obstacle.radius, 2 * obstacle.radius, obstacle.height])
            else:
                continue
            turn = np.array([0.0, 0.0, obstacle.yaw])
            yield self._grown(obstacle.name, np.array(obstacle.position), size + 2 * ROOM, turn, target)

    def _cup(self, target: FloatArray) -> Iterator[Body]:
        """Yield what keeps the fingers beside the cup: where one of them would touch it."""
        cup, scene = self.scenario.cup, self.scenario.scene
        if cup is None or scene is None or not self.shape.fingers or self.scenario.target != "cup":
            return
        if self._unsure:
            return
        axes = self._axes(target)
        size = np.array([2 * cup.radius, 2 * cup.radius, cup.height])
        turn = np.array([0.0, 0.0, math.atan2(axes[1, 2], axes[0, 2])])
        surface = target[2] - 0.5 * cup.height
        floor = surface + ROOM + MARGIN + LEDGE - self.shape.around(axes)[0][2]
        for finger in self.shape.fingers:
            yield self._grown("sides of the cup", target[:3], size, turn, target, [finger], floor)

    def _grown(
        self,
        name: str,
        centre: FloatArray,
        size: FloatArray,
        turn: FloatArray,
        target: FloatArray,
        parts: list[int] | None = None,
        floor: float = -math.inf,
    ) -> Box:
        """Return a box grown by the mirrored hand along its own axes; or by what is beside one finger."""
        own = matrices(turn).T
        low, high = self.shape.around(own @ self._axes(target))
        if parts is not None:  # between the fingers there is room for a cup
            beside, beyond = self.shape.around(own @ self._axes(target), parts)
            if beside[1] > 0:
                low[1] = beside[1]
            else:
                high[1] = beyond[1]
        least, most = -0.5 * size - high, 0.5 * size - low
        least[2] = max(least[2], min(floor - centre[2], most[2] - MARGIN))
        middle = centre + own.T @ (0.5 * (least + most))
        # The nearer a pole is to a face, the more room its influence has there: the fingers have little.
        inner = least[1] + INNER if least[1] > -most[1] else most[1] - INNER
        deep = np.array([most[0] - INNER, inner, 0.5 * (least[2] + most[2])])
        pole = tuple((centre + own.T @ deep).tolist()) if parts is not None else None
        return Box(
            name, tuple(middle.tolist()), tuple((most - least).tolist()), pole, turn=tuple(turn.tolist())
        )


def avoidance(scenario: Scenario, placement: Placement, kinematics: Kinematics) -> Avoidance | None:
    """Return what keeps skills out of the scene; None if there is nothing, or it is not wanted.

    Raises:
        UsageError: It is wanted, and the skill is not in three dimensions at their own scale.
    """
    if scenario.avoid is False or not scenario.furnished:
        return None
    if placement.plane is not None or placement.scale != 1:
        if scenario.avoid is None:
            return None
        raise UsageError(
            "avoid: bodies of the scene are known only to skills in three dimensions at scale 1.",
            hint="Leave --avoid out, or give --scale 1 to a skill in three dimensions.",
        )
    return Avoidance(scenario, placement, hand_shape(kinematics.model), kinematics)
