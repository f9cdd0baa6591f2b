"""Skills by reference, read and written."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from skillctl.model.combined import CombinedSkill
from skillctl.model.merged import MergedSkill
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import Skill
from skillctl.store import Artifact, Operation
from skillctl.store.source import open_skill


def load(reference: str | Path, *, store: str | Path | None = None) -> Skill:
    """Return the skill that a reference names, ready to be asked for velocities.

    Args:
        reference: ``path/to/file.h5``, ``name`` (its newest version), ``name@3`` or ``name@latest``.
        store: Where names live; default as on the command line.

    Raises:
        See ``open_skill``.
    """
    return open_skill(reference, store).skill


def save(skill: Skill, path: str | Path) -> Path:
    """Write a skill made or changed in Python to a file, without demonstrations or parents.

    Nothing is proved about it here: see ``verify``.

    Args:
        skill: What to write.
        path: The file; replaced if it exists.

    Returns:
        The path.

    Raises:
        StoreError: The file cannot be written.
    """
    from skillctl.store import current_provenance, encode, write_file  # late: reading needs none of them

    commands: dict[type, Literal["learn", "merge", "combine"]] = {
        SedsSkill: "learn",
        MergedSkill: "merge",
        CombinedSkill: "combine",
    }
    operation = Operation(command=commands[type(skill)], options={"from_python": True})
    artifact = Artifact(skill, (None,) * len(skill.leaves), operation, current_provenance())
    write_file(Path(path), encode(artifact))
    return Path(path)
