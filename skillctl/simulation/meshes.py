"""Mesh files that a robot or a scenario names: where they are, and whether Bullet reads them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from skillctl.errors import InputDataError, printable
from skillctl.opening import open_regular

READ = (".stl", ".obj", ".dae")  # by Bullet
SCHEMES = ("package://", "model://")
STL_HEADER, STL_COUNT, STL_TRIANGLE = 80, 4, 50  # bytes
LFS = b"version https://git-lfs"


def find_mesh(name: str, folder: Path) -> Path:
    """Return the file that a mesh's name means.

    A package is looked for in ``ROS_PACKAGE_PATH``, in ``share`` of the prefixes of ``AMENT_PREFIX_PATH``,
    and in the folders above; any other relative name in ``folder``, in the folders above, and here.

    Args:
        name: A path, or ``package://NAME/…``, ``model://NAME/…`` or ``file://…``.
        folder: Folder of the file that names the mesh.

    Raises:
        InputDataError: There is no such file, or Bullet does not read it.
    """
    plain = name.strip().replace("\\", "/")
    scheme = next((scheme for scheme in SCHEMES if plain.startswith(scheme)), None)
    if "://" in plain and scheme is None and not plain.startswith("file://"):
        raise _refused(name, "which is not on this machine", "Download the mesh, and name its file.")
    alike: list[Path] = []
    for path in _in_packages(plain[len(scheme) :], folder) if scheme else _near(plain, folder):
        if path.exists() and not path.is_dir():
            _require_readable(name, path)
            return path.resolve()
        if path.parent.is_dir():
            alike += [other for other in path.parent.iterdir() if other.name.lower() == path.name.lower()]
    if alike:
        raise _refused(name, "which is missing", f"There is {alike[0].name}: upper and lower case count.")
    if scheme:
        package = plain[len(scheme) :].partition("/")[0]
        raise _refused(
            name,
            "which is missing",
            f"Add the folder that holds {package} to ROS_PACKAGE_PATH, or its prefix to AMENT_PREFIX_PATH.",
        )
    raise _refused(name, "which is missing", "Copy the meshes with the file, or correct the name.")


def _refused(name: str, reason: str, hint: str) -> InputDataError:
    """Return an error that continues "this file refers to"."""
    return InputDataError(printable(f"{name!r}, {reason}"), hint=printable(hint))


def _near(name: str, folder: Path) -> Iterator[Path]:
    path = Path(name.removeprefix("file://"))
    for start in (folder, *folder.parents, Path.cwd()):
        yield start / path


def _in_packages(name: str, folder: Path) -> Iterator[Path]:
    package, _, rest = name.partition("/")
    roots = [Path(root) for root in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if root]
    prefixes = [Path(root) for root in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if root]
    for root in (*roots, *(prefix / "share" for prefix in prefixes), folder, *folder.parents):
        if root.name == package:
            yield root / rest
        yield root / package / rest
    for root in roots:  # packages may lie deeper in a workspace
        for depth in ("*", "*/*"):
            for found in sorted(root.glob(f"{depth}/{package}")):
                yield found / rest


def _require_readable(name: str, path: Path) -> None:
    size, suffix = path.stat().st_size, path.suffix.lower()
    with _opened(name, path) as file:
        start = file.read(STL_HEADER + STL_COUNT)
    if start.startswith(LFS):
        raise _refused(name, "which is a Git LFS pointer, not a mesh", "Fetch the meshes: git lfs pull")
    if size == 0:
        raise _refused(name, "which is empty", "Copy the mesh again.")
    if suffix not in READ:
        raise _refused(name, "which Bullet does not read", f"Convert it to one of {', '.join(READ)}.")
    if suffix == ".obj":
        for library in _named_in(name, path, b"mtllib"):
            for texture in _named_in(name, library, b"map_"):
                _opened(name, texture).close()
    if suffix == ".stl":
        count = int.from_bytes(start[STL_HEADER:], "little")
        if size >= STL_HEADER + STL_COUNT + count * STL_TRIANGLE and size >= STL_HEADER + STL_COUNT:
            return
        if start.lstrip().startswith(b"solid"):
            raise _refused(
                name,
                "which is an ASCII STL file; Bullet reads binary STL only",
                "Convert it to binary STL, for example with MeshLab or trimesh.",
            )
        raise _refused(name, "which is no STL file, or is cut off", "Copy the mesh again.")


def _opened(name: str, path: Path) -> BinaryIO:
    """Open a file that Bullet will open: of a pipe it would wait for the first byte."""
    try:
        return open_regular(path)
    except InputDataError:
        also = "" if path.name == Path(name).name else f", with {path.name}"
        raise _refused(
            f"{name}{also}", "which is not a regular file", "Copy what it holds into a file."
        ) from None


def _named_in(name: str, path: Path, key: bytes) -> list[Path]:
    """Return the files that exist of those that lines of a mesh, or of its materials, name."""
    with _opened(name, path) as file:
        lines = [line.split(maxsplit=1) for line in file if line.lstrip().startswith(key)]
    places = [path.parent / os.fsdecode(line[1].strip()) for line in lines if len(line) == 2]
    return [place for place in places if place.exists()]
