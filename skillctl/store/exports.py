"""The formats in which skills are exported: MATLAB's SEDS tools, JSON, NumPy."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np

from skillctl.arrays import FloatArray
from skillctl.errors import UsageError
from skillctl.model.joint import joint_mixture
from skillctl.model.seds import SedsSkill
from skillctl.store.artifact import Artifact, contents_of, metadata_of

# In place of the date that SciPy writes: the same skill gives the same bytes. Bytes 116 to 127 are MATLAB's.
MAT_HEADER = b"MATLAB 5.0 MAT-file, written by skillctl".ljust(116)


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A format that skills are exported in.

    Attributes:
        suffix: The ending of its files.
        one_leaf: Whether a file holds one learned skill only.
        encode: Returns the names of what a file holds, and its bytes, of an artifact and one of its leaves.
    """

    suffix: str
    one_leaf: bool
    encode: Callable[[Artifact, SedsSkill], tuple[tuple[str, ...], bytes]]


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


def _mat(artifact: Artifact, leaf: SedsSkill) -> tuple[tuple[str, ...], bytes]:
    if not leaf.space.flat:
        raise UsageError(
            "a .mat file holds a mixture that moves the state itself; this skill moves poses.",
            hint="Write .json or .npz, or learn it again with --position-only.",
        )
    if leaf.coordinates.links:
        raise UsageError(
            "a .mat file holds a mixture that moves the state itself; this skill has learned coordinates.",
            hint="Write .json or .npz, or learn it again with --coordinates identity.",
        )
    from scipy.io import savemat  # late: half a second that only this format needs

    file, variables = BytesIO(), seds_variables(leaf)
    savemat(file, variables)  # type: ignore[arg-type]  # it writes to open files, too
    return tuple(variables), MAT_HEADER + file.getvalue()[len(MAT_HEADER) :]


def _json(artifact: Artifact, leaf: SedsSkill) -> tuple[tuple[str, ...], bytes]:
    arrays = {path: array.tolist() for path, array in contents_of(artifact).items()}
    document = {"digest": artifact.digest, "meta": metadata_of(artifact), "arrays": arrays}
    return tuple(document), (json.dumps(document, indent=1, allow_nan=False) + "\n").encode("ascii")


def _npz(artifact: Artifact, leaf: SedsSkill) -> tuple[tuple[str, ...], bytes]:
    texts = {"digest": artifact.digest, "meta.json": json.dumps(metadata_of(artifact), sort_keys=True)}
    arrays: dict[str, Any] = {
        **contents_of(artifact),
        **{name: np.array(text) for name, text in texts.items()},
    }
    file = BytesIO()
    np.savez(file, **arrays)  # numbers and texts: nothing is pickled
    return tuple(arrays), file.getvalue()


EXPORT_FORMATS = (
    ExportFormat(".mat", True, _mat),
    ExportFormat(".json", False, _json),
    ExportFormat(".npz", False, _npz),
)
