"""A skill for other programs: MATLAB's SEDS tools, JSON, NumPy."""

from __future__ import annotations

import json
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.seds import SedsSkill
from skillctl.store import Artifact, Lock, contents_of, metadata_of, write_file
from skillctl.store.source import open_skill
from skillctl.usecases.inspect import joint_mixture

# In place of the date that SciPy writes: the same skill gives the same bytes. Bytes 116 to 127 are MATLAB's.
MAT_HEADER = b"MATLAB 5.0 MAT-file, written by skillctl".ljust(116)


@dataclass(frozen=True)
class ExportReport:
    """What was written.

    Attributes:
        skill, digest: The skill, and its content digest.
        path: The file.
        leaf: Which leaf was written, counted from 1; None for the whole skill.
        variables: Names in the file.
    """

    skill: str
    digest: str
    path: Path
    leaf: int | None
    variables: tuple[str, ...]


def export(
    reference: str | Path,
    output: Path,
    *,
    leaf: int | None = None,
    store: Path | None = None,
    lock: Lock | None = None,
) -> ExportReport:
    """Write a skill in a format that other programs read, chosen by the file's ending.

    ``.mat``: one SEDS skill in the layout of the MATLAB tools of its authors: ``Priors`` (1, K), ``Mu``
    (2d, K) and ``Sigma`` (2d, 2d, K) of the joint mixture of [ξ − ξ*; ξ̇], so the target is the origin;
    ``attractor`` (d, 1) says where it was. ``.json``, ``.npz``: all arrays of the artifact, its metadata.

    Args:
        reference: The skill.
        output: The file; replaced if it exists.
        leaf: For ``.mat``, which leaf of the skill, counted from 1; not needed if there is one.
        store: Where names live; default as on the command line.
        lock: Allow only skills that it names.

    Raises:
        UsageError: Another ending, or several leaves where one is needed.
        NotFoundError, ArtifactError: The reference leads to no intact skill.
        StoreError: The file cannot be written.
    """
    writers = {".mat": None, ".json": _json, ".npz": _npz}
    if output.suffix not in writers:
        raise UsageError(
            f"{output}: skills are exported as .mat, .json or .npz, told by the ending of the file.",
            hint=f"Name a file with one of these endings, as in -o {output.stem or 'skill'}.json.",
        )
    if leaf is not None and output.suffix != ".mat":
        raise UsageError("--leaf is for .mat files.", hint="Other files hold all leaves.")
    source = open_skill(reference, store, lock)
    writer = writers[output.suffix]
    if writer is None:
        leaf = _only_leaf(source.skill.leaves, leaf)
        variables = seds_variables(source.skill.leaves[leaf - 1])
        data = _mat(variables)
    else:
        variables, data = writer(source.artifact)
    write_file(output, data)
    return ExportReport(source.name, source.artifact.digest, output, leaf, tuple(variables))


def seds_variables(skill: SedsSkill) -> dict[str, FloatArray]:
    """Return what the MATLAB tools call Priors, Mu and Sigma, and where the origin was.

    References:
        Layout of SEDS_lib by S. M. Khansari-Zadeh: GMR over [position; velocity], target at the origin.
    """
    joint = joint_mixture(skill)
    means = joint.means.copy()
    means[:, : skill.dimension] -= skill.attractor
    return {
        "Priors": joint.priors[None],
        "Mu": means.T,
        "Sigma": np.moveaxis(joint.covariances, 0, -1),
        "attractor": skill.attractor[:, None],
    }


def _only_leaf(leaves: tuple[SedsSkill, ...], leaf: int | None) -> int:
    if leaf is None and len(leaves) == 1:
        return 1
    if leaf is None or not 1 <= leaf <= len(leaves):
        raise UsageError(
            f"a .mat file holds one mixture, and this skill has {len(leaves)}"
            + (f", so there is no leaf {leaf}." if leaf is not None else "."),
            hint=f"Choose one with --leaf 1 to {len(leaves)}, or write .json or .npz.",
        )
    return leaf


def _mat(variables: dict[str, FloatArray]) -> bytes:
    from scipy.io import savemat

    file = BytesIO()
    savemat(file, variables)  # type: ignore[arg-type]  # it writes to open files, too
    return MAT_HEADER + file.getvalue()[len(MAT_HEADER) :]


def _json(artifact: Artifact) -> tuple[dict[str, Any], bytes]:
    document = {"digest": artifact.digest, "meta": metadata_of(artifact)}
    document["arrays"] = {path: array.tolist() for path, array in contents_of(artifact).items()}
    return document, (json.dumps(document, indent=1, allow_nan=False) + "\n").encode("ascii")


def _npz(artifact: Artifact) -> tuple[dict[str, Any], bytes]:
    file = BytesIO()
    texts = {"digest": artifact.digest, "meta.json": json.dumps(metadata_of(artifact), sort_keys=True)}
    arrays: dict[str, Any] = {
        **contents_of(artifact),
        **{name: np.array(text) for name, text in texts.items()},
    }
    np.savez(file, **arrays)  # numbers and texts: nothing is pickled
    return arrays, file.getvalue()
