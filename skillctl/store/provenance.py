"""Where a skill comes from: the records of it."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import skillctl
from skillctl.errors import UsageError
from skillctl.store.canonical import dump_canonical
from skillctl.store.schema import InputRecord, Operation, ParentRecord, Provenance, is_relative, label

# The libraries that compute the numbers; the content does not depend on HDF5.
LIBRARIES = ("numpy", "scipy")


def input_record(path: Path, sha256: str, importer: str) -> InputRecord:
    """Return the record of a file: its path as given, or only its name if the path is absolute or leads up.

    So the record names no user and no machine, and does not depend on where the command was started. In a
    name that some system takes for a path elsewhere, such as ``a:0.csv``, underscores make it harmless.
    """
    as_given = Path(os.path.normpath(path))
    inside = not as_given.is_absolute() and ".." not in as_given.parts
    name = label((as_given if inside else Path(as_given.name)).as_posix()).lstrip("/")
    return InputRecord(
        path=name if is_relative(name) else re.sub(r"[\\:]", "_", name),
        sha256=sha256,
        importer=importer,
    )


def current_provenance(
    *, inputs: Iterable[InputRecord] = (), parents: Iterable[ParentRecord] = ()
) -> Provenance:
    """Return the provenance of a skill made now, by this build.

    Raises:
        UsageError: SOURCE_DATE_EPOCH is set, but is not a number of seconds.
    """
    return Provenance(
        inputs=tuple(inputs),
        parents=tuple(parents),
        tool=skillctl.__version__,
        libraries={name: installed for name in LIBRARIES if (installed := _installed_version(name))},
        date=_date(os.environ.get("SOURCE_DATE_EPOCH", "")),
    )


def input_fingerprint(operation: Operation, provenance: Provenance) -> str:
    """Return one SHA-256 over everything that a result depends on, before it is computed.

    Two artifacts with equal fingerprints come from the same command, options, seed, bytes of the inputs
    (in any place), parents and version of skillctl, so the second need not be made.
    """
    decides = {
        "command": operation.command,
        "options": operation.model_dump(mode="json")["options"],
        "seed": operation.seed,
        "inputs": [[record.sha256, record.importer] for record in provenance.inputs],
        "parents": [[record.digest, record.role] for record in provenance.parents],
        "tool": provenance.tool,
    }
    return hashlib.sha256(dump_canonical(decides)).hexdigest()


def _installed_version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _date(epoch: str) -> str | None:
    if not epoch:
        return None
    try:
        moment = datetime.fromtimestamp(int(epoch), tz=timezone.utc)
    except (ValueError, OverflowError, OSError):
        raise UsageError(
            f"SOURCE_DATE_EPOCH: expected a whole number of seconds, got {epoch[:40]!r}.",
            hint="Unset it, or use the output of `date +%s`.",
        ) from None
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")
