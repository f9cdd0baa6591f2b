"""The formats of demonstrations, and recognition of a file's format by its content.

To add a format, write a module with two functions and name it in ``FORMATS``:

- ``recognises(file: File) -> bool`` returns whether the content looks like this format;
- ``read(file: File) -> list[Recording]`` returns the demonstrations, or raises InputDataError.

Choices, help and messages follow from the records. Nothing here imports NumPy; the readers do, when called.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from skillctl.errors import InputDataError, UsageError

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
    """

    name: str
    help: str
    suffixes: tuple[str, ...]
    reader: str

    def recognises(self, file: File) -> bool:
        """Return whether the content of a file looks like this format."""
        return bool(self._module.recognises(file))

    def read(self, file: File) -> list[Recording]:
        """Return the demonstrations in a file of this format.

        Raises:
            InputDataError: The file is damaged, or of another format or layout.
        """
        recordings: list[Recording] = self._module.read(file)
        return recordings

    @property
    def _module(self) -> Any:
        return import_module(f"{__package__}.{self.reader}")


FORMATS = (
    Format("csv", "CSV and TSV tables", (".csv", ".tsv", ".txt"), "table"),
    Format("tum", "TUM trajectories", (".txt",), "tum"),
    Format("npz", "NumPy archives and arrays", (".npz", ".npy"), "archive"),
    Format("robomimic", "robomimic datasets", (".hdf5",), "robomimic"),
    Format("lasa", "LASA motions", (".mat",), "lasa"),
    Format("lpvds", "LPV-DS demonstrations", (".mat",), "lpvds"),
)
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


def format_of(file: File) -> Format:
    """Return the format that the content of a file has.

    Raises:
        InputDataError: The file is damaged, or of none of ``FORMATS``.
    """
    for start, (what, hint) in FOREIGN.items():
        if file.content.startswith(start):
            raise InputDataError(f"{file.path}: {what}.", hint=hint)
    for form in (*FORMATS[1:], FORMATS[0]):  # tables last: any text may be one
        if form.recognises(file):
            return form
    from skillctl.demonstrations import matlab  # late: it needs NumPy

    if matlab.recognises(file):
        expected = "demos (LASA: structs of pos, vel, t) or data (LPV-DS: matrices [x; dx/dt])"
        raise matlab.other_layout(file, "a MATLAB file of unknown layout", expected)
    raise InputDataError(
        f"{file.path}: neither text nor a format that skillctl knows.",
        hint=f"Demonstrations are read from {described()}.",
    )
