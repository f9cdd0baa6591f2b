"""What a skill is: demonstrations, mixtures, the skill tree, the controller. NumPy only, no files."""

from skillctl.model.controller import Controller
from skillctl.model.demonstration import Demonstration, DemonstrationSet, StateSpace
from skillctl.model.mixture import GaussianMixture
from skillctl.model.rollout import Rollouts, rollout
from skillctl.model.skill import CombinedSkill, MergedSkill, SedsSkill, Skill

__all__ = [
    "CombinedSkill",
    "Controller",
    "Demonstration",
    "DemonstrationSet",
    "GaussianMixture",
    "MergedSkill",
    "Rollouts",
    "SedsSkill",
    "Skill",
    "StateSpace",
    "rollout",
]
