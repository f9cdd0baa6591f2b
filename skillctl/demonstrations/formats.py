"""The formats of demonstrations, and recognition of a file's format by its content.

To add a format, write a module with two functions and name it in ``FORMATS``:

- ``recognises(file: File) -> bool`` returns whether the content looks like this format;
- ``read(file: File) -> list[Recording]`` returns the demonstrations, or raises InputDataError.

Choices, help and messages follow from the records. Nothing here imports NumPy; the readers do, when called.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skillctl.errors import InputDataError, NotFoundError, UsageError

if TYPE_CHECKING:
    from skillctl.demonstrations.files import File
    from skillctl.demonstrations.recording import Recording


@dataclass(frozen=True, slots=True)
class Format:
    """A format in which demonstrations are read.

    Attributes:
        name: What ``input_format`` calls it.
        help: Description of such files.
        suffixes: Usual endings of their names; only the content decides.
        reader: Module of this package that recognises and reads them.
        folder: What is read of a folder in this format: patterns of files; it has the first one.
        needs: Third-party package that reads it, if skillctl works without.
    """

    name: str
    help: str
    suffixes: tuple[str, ...]
    reader: str
    folder: tuple[str, ...] = ()
    needs: str = ""

    def recognises(self, file: File) -> bool:
        """Return whether the content of a file looks like this format."""
        return bool(self._module.recognises(file))

    def read(self, file: File) -> list[Recording]:
        """Return the demonstrations in a file of this format.

        Raises:
            NotFoundError: The package that reads this format is not installed.
            InputDataError: The file is damaged, or of another format or layout.
        """
        if self.needs and find_spec(self.needs) is None:
            raise NotFoundError(
                f"{file.path}: {self.needs} is not installed; it reads {self.help}.",
                hint=f"pip install {self.needs}",
            )
        recordings: list[Recording] = self._module.read(file)
        return recordings

    @property
    def _module(self) -> Any:
        return import_module(f"{__package__}.{self.reader}")


FORMATS = (
    Format("csv", "CSV and TSV tables", (".csv", ".tsv", ".txt"), "table"),
    Format("tum", "TUM trajectories", (".txt",), "tum"),
    Format("npz", "NumPy archives and arrays", (".npz", ".npy"), "archive"),
    Format("robomimic", "datasets of robomimic, ManiSkill, ALOHA and RoboSet", (".hdf5", ".h5"), "robomimic"),
    Format("lasa", "LASA motions", (".mat",), "lasa"),
    Format("lpvds", "LPV-DS demonstrations", (".mat",), "lpvds"),
    Format("damm", "DAMM demonstrations", (".mat",), "damm"),
    Format(
        "bag", "bags of ROS 1 and 2", (".bag", ".mcap", ".db3"), "bags",
        folder=("metadata.yaml", "*.mcap", "*.db3"), needs="rosbags",
    ),
    Format(
        "lerobot", "LeRobot datasets", ("folder",), "lerobot",
        folder=("meta/info.json", "meta/episodes/**/*.parquet", "data/**/*.parquet"), needs="pyarrow",
    ),
)  # fmt: skip
FOREIGN = {  # first bytes of files that are given by mistake, what they are, and a hint
    b"\x89SKILL": ("a skill, not a demonstration", "Inspect it with: skillctl inspect"),
    b"MATLAB 7.3": ("a MATLAB 7.3 file, which is not read", "Save it in MATLAB with: save -v7"),
    b"\x1f\x8b": ("compressed with gzip", "Unpack it with: gunzip"),
    b"%PDF": ("a PDF document", "Name a demonstration file."),
    b"\x89PNG": ("a picture", "Name a demonstration file."),
}


def described() -> str:
    """Return a list of the formats, with the usual endings of their files."""
    return ", ".join(f"{form.help} ({', '.join(form.suffixes)})" for form in FORMATS)


def named(name: str) -> Format:
    """Return the format of this name.

    Raises:
        UsageError: There is none.
    """
    for form in FORMATS:
        if form.name == name:
            return form
    names = ", ".join(form.name for form in FORMATS)
    raise UsageError(f"input format: {name!r} is none of {names}.")


def files_of(path: Path) -> list[Path]:
    """Return the files that a path stands for: itself, or those of a folder that its format reads."""
    form = _folder_format(path)
    return [path] if form is None else sorted(f for pattern in form.folder for f in path.glob(pattern))


def size_of(path: Path) -> int:
    """Return the size of what is read at a path, [bytes]; 0 if that cannot be known."""
    try:
        return sum(file.stat().st_size for file in files_of(path))
    except (OSError, ValueError):  # whoever reads it says in words what is wrong
        return 0


def digest_of(path: Path) -> str:
    """Return the SHA-256 of what is read at a path: a file's bytes, or the names and files of a folder."""
    from skillctl.demonstrations.files import sha256_of  # late: --help needs no processes

    form = _folder_format(path)
    if form is None:
        return sha256_of(path)
    digest = hashlib.sha256()
    for file in files_of(path):
        digest.update(f"{sha256_of(file)} {file.relative_to(path)}\n".encode(errors="surrogateescape"))
    return digest.hexdigest()


def _folder_format(path: Path) -> Format | None:
    """Return the format of a folder, None if it has none, is a file, or may not be looked into."""
    try:
        return next((form for form in FORMATS if form.folder and (path / form.folder[0]).is_file()), None)
    except OSError:
        return None


def format_of(file: File, forced: Format | None = None) -> Format:
    """Return the format that a file has by its content, or the one that the user forces it to have.

    Raises:
        InputDataError: The file is damaged, or of none of ``FORMATS``.
    """
    if file.path.is_dir():
        form = _folder_format(file.path)
        if form is None or forced not in (None, form):
            known = {suffix for each in FORMATS for suffix in each.suffixes if suffix.startswith(".")}
            there = sorted({member.suffix for member in file.path.iterdir()} & known)
            ending = there[0] if there else ""
            raise InputDataError(
                f"{file.path}: is a folder, not a file.", hint=f"Name its files: {file.path}/*{ending}"
            )
        return form
    if forced is not None:
        return forced
    for start, (what, hint) in FOREIGN.items():
        if file.content.startswith(start):
            raise InputDataError(f"{file.path}: {what}.", hint=hint)
    for form in (*FORMATS[1:], FORMATS[0]):  # tables last: any text may be one
        if form.recognises(file):
            return form
    from skillctl.demonstrations import matlab  # late: it needs NumPy

    if matlab.recognises(file):
        expected = (
            "demos (LASA: structs of pos, vel, t), data (LPV-DS: matrices [x; dx/dt]) or data_ee_pose (DAMM: "
            "structs of pose)"
        )
        raise matlab.other_layout(file, "a MATLAB file of unknown layout", expected)
    raise InputDataError(
        f"{file.path}: neither text nor a format that skillctl knows.",
        hint=f"Demonstrations are read from {described()}.",
    )
