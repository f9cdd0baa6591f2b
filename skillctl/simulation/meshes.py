"""Mesh files that a robot or a scenario names: where they are, and whether Bullet reads them."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import BinaryIO

from skillctl.errors import InputDataError, printable
from skillctl.opening import open_regular

READ = (".stl", ".obj", ".dae")  # by Bullet
SCHEMES = ("package://", "model://")
STL_HEADER, STL_COUNT, STL_TRIANGLE = 80, 4, 50  # bytes
LFS = b"version https://git-lfs"
LOOKED_IN = ("", "data", *("/".join([*[".."] * up, "data"]) for up in range(1, 5)))
LONGEST_NAME = 255  # bytes; Bullet reads longer lines in pieces
# What Bullet opens besides a mesh: the materials of an OBJ file, and the picture of each.
MATERIALS = re.compile(rb"mtllib[ \t]+([^\s\0]+)")
PICTURE = re.compile(rb"^(?:[^#\r\n]*|[^\r\n]{900,})map_Kd[ \t]+([^\r\n\0]*[^\r\n\0 \t])", re.MULTILINE)


def find_mesh(name: str, folder: Path, told: Sequence[Path] | None = None) -> Path:
    """Return the file that a mesh's name means.

    A package is looked for in ``told``, in ``ROS_PACKAGE_PATH``, in ``share`` of the prefixes of
    ``AMENT_PREFIX_PATH``, and in the folders above; any other relative name in ``folder``, in the folders
    above, in ``told``, and here.

    Args:
        name: A path, or ``package://NAME/…``, ``model://NAME/…`` or ``file://…``.
        folder: Folder of the file that names the mesh.
        told: Folders that may be read besides those of the variables and the package of ``folder``, which is
            the nearest folder above with a ``package.xml``, else ``folder``; links count as what they lead
            to. None: any may.

    Raises:
        InputDataError: There is no such file, it may not be read, or Bullet does not read it.
    """
    plain = name.strip().replace("\\", "/")
    scheme = next((scheme for scheme in SCHEMES if plain.startswith(scheme)), None)
    if "://" in plain and scheme is None and not plain.startswith("file://"):
        raise _refused(name, "which is not on this machine", "Download the mesh, and name its file.")
    readable = None if told is None else (_package(folder), *(root.resolve() for root in (*told, *_roots())))
    places = _in_packages(plain[len(scheme) :], folder, told or ()) if scheme else _near(plain, folder, told)
    alike: list[Path] = []
    outside: list[Path] = []
    for path in places:
        found = path.resolve()
        if not _may_read(found.parent, readable):
            outside += [found] if path.is_file() else []
        elif path.exists() and not path.is_dir():
            _require_readable(name, path)
            if path.suffix.lower() == ".obj":
                _require_companions(name, found, readable)
            return found
        elif path.parent.is_dir():
            alike += [other for other in path.parent.iterdir() if other.name.lower() == path.name.lower()]
    if alike:
        raise _refused(name, "which is missing", f"There is {alike[0].name}: upper and lower case count.")
    if outside:
        raise _outside(name, outside[0], folder)
    if scheme:
        package = plain[len(scheme) :].partition("/")[0]
        raise _refused(
            name,
            "which is missing",
            f"Name the folder that holds {package} with --package, or add it to ROS_PACKAGE_PATH, or its "
            "prefix to AMENT_PREFIX_PATH.",
        )
    raise _refused(name, "which is missing", "Copy the meshes with the file, or correct the name.")


def _package(folder: Path) -> Path:
    above = (folder, *folder.parents)
    return next((each for each in above if (each / "package.xml").is_file()), folder).resolve()


def _may_read(place: Path, readable: Sequence[Path] | None) -> bool:
    return readable is None or any(place.is_relative_to(root) for root in readable)


def _outside(name: str, path: Path, folder: Path) -> InputDataError:
    return _refused(
        name,
        f"which is {path}, outside of {_package(folder)}",
        f"If it may be read, add --package {path.parent}, or that folder to ROS_PACKAGE_PATH.",
    )


def _require_companions(name: str, mesh: Path, readable: Sequence[Path] | None) -> None:
    """Raise InputDataError if Bullet would read what it may not, or wait, for the materials of a mesh."""
    for library in _named_in(name, mesh, MATERIALS):
        materials = mesh.parent / library
        if not materials.exists():
            continue  # Bullet looks nowhere else
        _require_companion(f"{name}, with {library}", materials, mesh.parent, readable)
        for picture in _named_in(name, materials, PICTURE):
            places = (mesh.parent / picture, *_elsewhere(picture))
            if found := next((place for place in places if place.exists()), None):
                _require_companion(f"{name}, with {picture}", found, mesh.parent, readable)


def _require_companion(name: str, path: Path, folder: Path, readable: Sequence[Path] | None) -> None:
    if not _may_read(path.resolve().parent, readable):
        raise _outside(name, path.resolve(), folder)
    _opened(name, path).close()


def _named_in(name: str, path: Path, key: re.Pattern[bytes]) -> list[str]:
    """Return the files that a mesh, or its materials, name; Bullet takes none of them as an absolute path."""
    with _opened(name, path) as file:
        named = sorted(set(key.findall(file.read())))
    if any(len(each) > LONGEST_NAME for each in named):
        raise _refused(f"{name}, with {path.name}", "which names no file", "Correct the long name in it.")
    return [os.fsdecode(each).lstrip("/") for each in named]


def _elsewhere(picture: str) -> Iterator[Path]:
    """Return where Bullet looks for a picture that is not beside its mesh."""
    for start in (Path.cwd(), Path(sys.executable).resolve().parent):
        for first, second in product(LOOKED_IN, repeat=2):
            yield start / first / second / picture


def _refused(name: str, reason: str, hint: str) -> InputDataError:
    """Return an error that continues "this file refers to"."""
    return InputDataError(printable(f"{name!r}, {reason}"), hint=printable(hint))


def _near(name: str, folder: Path, told: Sequence[Path] | None) -> Iterator[Path]:
    path = Path(name.removeprefix("file://"))
    for start in (folder, *folder.parents, *(told or ()), Path.cwd()):
        yield start / path


def _roots() -> tuple[Path, ...]:
    """Return the folders of packages that the variables of ROS name."""
    roots = [Path(root) for root in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if root]
    prefixes = [Path(root) for root in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if root]
    return (*roots, *(prefix / "share" for prefix in prefixes))


def _in_packages(name: str, folder: Path, told: Sequence[Path]) -> Iterator[Path]:
    package, _, rest = name.partition("/")
    roots = (*told, *_roots())
    for root in (*roots, folder, *folder.parents):
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
