"""The one place that opens HDF5 to read skills; everything in a file is checked before it is used."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np

from skillctl.errors import ArtifactError, InputDataError, InvalidModelError
from skillctl.store.artifact import Artifact, artifact_of
from skillctl.store.errors import InvalidArtifactError, LaterFeature, LaterFeatureError, Refusal
from skillctl.store.files import read_once
from skillctl.store.hdf5 import h5py
from skillctl.store.layout import Array, content_digest
from skillctl.store.policy import checked_datasets
from skillctl.store.seal import Header, require_seal, require_stated
from skillctl.store.tree import node_of


def read_skill(path: Path) -> Artifact:
    """Return the artifact in a file.

    Raises:
        NotFoundError: There is no such file.
        StoreError: The system does not let us read it.
        ArtifactError: It is not an intact artifact of a format this build reads; see ``store.errors``.
    """
    return decode(read_once(path), str(path))


def decode(data: bytes, name: str = "artifact") -> Artifact:
    """Return the artifact that ``encode`` made these bytes of; ``name`` is for messages.

    Raises:
        ArtifactError: Anything breaks a rule of the format.
    """
    header, arrays = _read_arrays(data, name)
    with _refusing(name):
        artifact = artifact_of(arrays, name, header.format)
    require_stated(header, node_of(artifact.skill).kind, artifact.digest, name)
    return artifact


def digest_of(data: bytes, name: str = "artifact") -> str:
    """Return the content digest of an artifact's bytes, after all checks but those of the model.

    Raises:
        ArtifactError: Damaged, or a layout that the format does not allow.
    """
    header, arrays = _read_arrays(data, name)
    digest = content_digest(arrays, header.format)
    require_stated(header, header.kind, digest, name)
    return digest


def _read_arrays(data: bytes, name: str) -> tuple[Header, dict[str, Array]]:
    """Return the header, and the arrays by path: seal first, then every rule, then the numbers."""
    header = require_seal(data, name)
    with _refusing(name), h5py.File(BytesIO(data), "r") as file:
        datasets = checked_datasets(file.id, name, header.format)
        return header, {path: _read(dataset) for path, dataset in datasets.items()}


def _read(dataset: h5py.h5d.DatasetID) -> Array:
    array = np.empty(dataset.shape, dataset.dtype)
    dataset.read(h5py.h5s.ALL, h5py.h5s.ALL, array)
    return array


@contextmanager
def _refusing(name: str) -> Iterator[None]:
    try:
        # Numbers near the limits of float64 lead to infinities, which the checks refuse; NumPy need not warn.
        with np.errstate(all="ignore"):
            yield
    except ArtifactError:
        raise
    except LaterFeature as feature:
        raise LaterFeatureError(name, str(feature)) from None
    except (Refusal, InvalidModelError, InputDataError) as error:
        raise InvalidArtifactError(name, str(error).rstrip(".")) from error
    except Exception as error:  # h5py raises seven types of exception on contents it cannot read
        if isinstance(error.__cause__, KeyboardInterrupt):  # in h5py's own code it becomes a SystemError
            raise error.__cause__ from None
        raise InvalidArtifactError(name, f"HDF5 cannot read it ({error!r:.200})") from error
