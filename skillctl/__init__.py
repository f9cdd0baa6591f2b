"""Robot skills: learn them from demonstrations, make new ones from learned ones, prove them stable.

    from skillctl import Controller, learn, load, simulate, verify

    report = learn(["1.csv", "2.csv"], name="reach", store="skills")
    skill = load("reach", store="skills")  # or load(report.written.path)
    skill.velocity([0.42, 0.0, 0.55])  # one state (d,) or many (n, d), in metres → metres per second

    certificate = verify(skill)  # .verdict, .rate [1/s], .period [s]
    controller = Controller(skill, period=0.01)  # refuses a period above the proved one
    command = controller.step([0.42, 0.0, 0.55])  # once a period: measured position → velocity to command

Positions are in the unit of the skill (m, or rad for joints) and in its frame; ``skill.space`` has both.

``learn``, ``merge``, ``combine`` and ``chain`` do what the commands of these names do: they make a skill,
prove it, write it to a file (``output=``) or into the store (``name=``) together with what it was made
from, and return a report with ``written`` and ``certificate``. ``load`` returns the skill itself, an
immutable value with ``velocity``, ``translated``, ``leaves`` and ``space``. ``save`` writes a skill that
was changed in Python, without a proof and without a history. A path may be given as text; a ``Path`` is
always a file. All errors are subclasses of `SkillctlError` in `skillctl.errors`, and have the ``hint``
that the command would print; a state that is not finite raises `StateError`.

A name is imported when it is first used. Everything else, such as ``MergedSkill``, is imported from the
module that defines it: ``from skillctl.model.merged import MergedSkill``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skillctl.adapt.options import TaskOptions
    from skillctl.compose.options import ChainOptions, CombineOptions, MergeOptions
    from skillctl.demonstrations.options import Reading
    from skillctl.errors import SkillctlError
    from skillctl.learning.options import LearnOptions
    from skillctl.model.controller import Controller
    from skillctl.model.coordinates.bodies import Ball, Box, Cylinder, Ellipsoid
    from skillctl.model.kept_out import kept_out
    from skillctl.model.rollout import rollout
    from skillctl.simulation.scenario import Scenario
    from skillctl.usecases.chain import chain
    from skillctl.usecases.combine import combine
    from skillctl.usecases.files import load, save
    from skillctl.usecases.inspect import inspect
    from skillctl.usecases.learn import learn
    from skillctl.usecases.merge import merge
    from skillctl.usecases.simulate import simulate
    from skillctl.usecases.verify_stability import verify

__version__ = "0.2.0.dev0"

__all__ = [
    "Ball",
    "Box",
    "ChainOptions",
    "CombineOptions",
    "Controller",
    "Cylinder",
    "Ellipsoid",
    "LearnOptions",
    "MergeOptions",
    "Reading",
    "Scenario",
    "SkillctlError",
    "TaskOptions",
    "__version__",
    "chain",
    "combine",
    "inspect",
    "kept_out",
    "learn",
    "load",
    "merge",
    "rollout",
    "save",
    "simulate",
    "verify",
]

_HOMES = {
    "Ball": "skillctl.model.coordinates.bodies",
    "Box": "skillctl.model.coordinates.bodies",
    "ChainOptions": "skillctl.compose.options",
    "CombineOptions": "skillctl.compose.options",
    "Controller": "skillctl.model.controller",
    "Cylinder": "skillctl.model.coordinates.bodies",
    "Ellipsoid": "skillctl.model.coordinates.bodies",
    "LearnOptions": "skillctl.learning.options",
    "MergeOptions": "skillctl.compose.options",
    "Reading": "skillctl.demonstrations.options",
    "Scenario": "skillctl.simulation.scenario",
    "SkillctlError": "skillctl.errors",
    "TaskOptions": "skillctl.adapt.options",
    "chain": "skillctl.usecases.chain",
    "combine": "skillctl.usecases.combine",
    "inspect": "skillctl.usecases.inspect",
    "kept_out": "skillctl.model.kept_out",
    "learn": "skillctl.usecases.learn",
    "load": "skillctl.usecases.files",
    "merge": "skillctl.usecases.merge",
    "rollout": "skillctl.model.rollout",
    "save": "skillctl.usecases.files",
    "simulate": "skillctl.usecases.simulate",
    "verify": "skillctl.usecases.verify_stability",
}

if not TYPE_CHECKING:  # a type checker shall see the names above and no others

    def __getattr__(name: str) -> object:
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
