"""The same inputs give the same bytes anywhere: python tests/torture/same_bytes.py [OTHER-PYTHON ...]

Learns, merges and combines in processes with other hash seeds, time zones, locales, masks, threads and
working directories, under this Python and every other that is named (and has what skillctl needs). Files must
be the same where NumPy, SciPy and h5py are, and the content digests of the archived artifacts everywhere.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
SURROUNDINGS: tuple[dict[str, str], ...] = (
    {"PYTHONHASHSEED": "0", "TZ": "UTC", "LC_ALL": "C", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    {"PYTHONHASHSEED": "1", "TZ": "Asia/Kathmandu", "LC_ALL": "C.UTF-8", "OMP_NUM_THREADS": "2",
     "HDF5_USE_FILE_LOCKING": "FALSE"},
    {"PYTHONHASHSEED": "2", "TZ": "America/St_Johns", "LC_ALL": "de_DE.UTF-8", "OPENBLAS_NUM_THREADS": "4",
     "PYTHONOPTIMIZE": "1", "HDF5_PLUGIN_PATH": "/nowhere"},
)  # fmt: skip


def made_here() -> dict[str, Any]:
    """Return what this process makes: content digest and SHA-256 of each file, and the libraries it used."""
    import h5py
    import numpy as np
    import scipy

    sys.path.insert(0, str(HERE))
    import specimens

    from skillctl import store

    spec = importlib.util.spec_from_file_location("make_v2", HERE.parent / "archives" / "v2" / "make.py")
    assert spec is not None
    assert spec.loader is not None
    spec.loader.exec_module(archive := importlib.util.module_from_spec(spec))
    archived = {name: store.encode(made) for name, made in archive.archive().items()}

    def names(files: dict[str, bytes]) -> dict[str, list[str]]:
        return {name: [store.digest_of(d), hashlib.sha256(d).hexdigest()] for name, d in files.items()}

    libraries = [np.__version__, scipy.__version__, h5py.__version__, h5py.version.hdf5_version]
    return {
        "python": sys.version.split()[0],
        "libraries": libraries,
        "archived": names(archived),
        "learned": names(specimens.make_anywhere()),
    }


def made_by(python: str, number: int, folder: Path) -> dict[str, Any]:
    """Return what a process of a Python makes in one of the surroundings."""
    (there := folder / f"{number}").mkdir(exist_ok=True)
    run = subprocess.run(
        [python, str(Path(__file__).resolve()), "--here"],
        env={**os.environ, "PYTHONPATH": str(ROOT), **SURROUNDINGS[number]},
        cwd=there, umask=0o077 * (number % 2), capture_output=True, text=True, check=True,
    )  # fmt: skip
    made: dict[str, Any] = json.loads(run.stdout)
    return made


def differences(first: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """Return the names of artifacts that two processes should have made alike, and did not."""
    if first["libraries"] == other["libraries"]:
        return [
            name
            for kind in ("archived", "learned")
            for name in first[kind]
            if first[kind][name] != other[kind].get(name)
        ]
    return [name for name, (digest, _) in first["archived"].items() if digest != other["archived"][name][0]]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("pythons", nargs="*", metavar="OTHER-PYTHON")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.here:
        print(json.dumps(made_here()))
        return 0
    earlier: list[dict[str, Any]] = []
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for python in [sys.executable, *options.pythons]:
            for number in range(len(SURROUNDINGS)):
                made = made_by(python, number, Path(folder))
                unlike = sorted({name for other in earlier for name in differences(other, made)})
                earlier.append(made)
                wrong += len(unlike)
                about = f"Python {made['python']}, NumPy, SciPy, h5py, HDF5 {' '.join(made['libraries'])}"
                count = len(made["archived"]) + len(made["learned"])
                print(
                    f"{about}, surroundings {number + 1}: {count} files, {unlike or 'none'} unlike",
                    flush=True,
                )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
