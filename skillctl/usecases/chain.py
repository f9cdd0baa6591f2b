"""Chain skills: one acts after the other, each towards its own target, with events between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from skillctl.compose.options import ChainOptions
from skillctl.errors import FitError
from skillctl.model.chained import ChainedSkill
from skillctl.stability.certificate import certify
from skillctl.stability.report import Certificate
from skillctl.stability.stages import level_within
from skillctl.store import Artifact, Lock, Operation
from skillctl.store.source import carried_reports, open_skill
from skillctl.store.ties import stage_role
from skillctl.usecases.destination import Destination
from skillctl.usecases.make import MakeReport, PartSummary, Request, child_artifact, make, require_stable, write_child

IN_ANOTHER_WAY = "Put the stages in another order, or end one elsewhere with --target STAGE=…"


@dataclass(frozen=True)
class StageSummary:
    """One stage of a new chain.

    Attributes:
        stage: Counted from 1.
        skill, digest: How the skill was named that it is, and its content digest.
        target: Where it ends, in the numbers in which targets are given; of several, one row each.
        events: What happens once it is over.
        
    """
