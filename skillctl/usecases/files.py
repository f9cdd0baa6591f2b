"""Load and save skills."""

from __future__ import annotations

from pathlib import Path

from skillctl.model.golden import golden_motions
from skillctl.model.skill import Skill
from skillctl.store import Artifact, Operation
from skillctl.store.references import require_file_name
from skillctl.store.source import open_skill


def load(reference: str | Path, *, store: str | Path | None = None) -> Skill:
    """Return the skill that a reference names.

    Args:
        reference: ``path/to/file.h5``, ``name`` (its newest version), ``name@3`` or ``name@latest``; a
            ``Path`` is always a file.
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
        UsageError: A path that ``load`` would take for a name in the store, or one among a store's versions.
        StoreError: The file cannot be written.
    """
    from skillctl.store import (
        current_provenance,
        encode,
        require_outside_store,
        write_file,
    )  # late: reading needs none of them

    file = require_file_name(path)
    require_outside_store(file)
    unshown, made = (None,) * len(skill.leaves), Operation(command="python")
    artifact = Artifact(skill, unshown, made, current_provenance(), golden=golden_motions(skill))
    write_file(file, encode(artifact))
    return file
