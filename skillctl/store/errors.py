"""Why a file was refused: one class for each thing a caller may want to do about it."""

from __future__ import annotations

from skillctl.errors import ArtifactError, printable

READABLE_FORMATS = (1,)


class Refusal(Exception):  # noqa: N818 - not an error of its own: the reader adds the file's name
    """A reason to refuse a file, raised where the file's name is not known."""


class NotAnArtifactError(ArtifactError):
    """Something else than a skill artifact: another file format, an empty file, a directory, a link."""

    def __init__(self, name: str, reason: str, *, hint: str = "") -> None:
        self.name, self.reason = name, reason
        super().__init__(
            f"{printable(name)} is not a skill artifact: {printable(reason)}.",
            hint=hint or "Make one with `skillctl learn DATA -o FILE.h5`.",
        )


class DamagedArtifactError(ArtifactError):
    """An artifact whose bytes are not the ones that were written."""

    def __init__(self, name: str, reason: str) -> None:
        self.name, self.reason = name, reason
        super().__init__(
            f"{printable(name)} is damaged: {printable(reason)}.",
            hint="Copy it again from where it came from (in binary mode), or make it again from its inputs.",
        )


class InvalidArtifactError(ArtifactError):
    """A sealed file whose contents break a rule of the format: it was not written by skillctl."""

    def __init__(self, name: str, reason: str) -> None:
        self.name, self.reason = name, reason
        super().__init__(
            f"{printable(name)} is not a valid skill artifact: {printable(reason)}.",
            hint="Its seal is intact, so it was written like this; do not use it, ask whoever made it.",
        )


class UnsupportedFormatError(ArtifactError):
    """An artifact of a format version that this build does not read."""

    def __init__(self, name: str, found: int, hint: str) -> None:
        self.name, self.found, self.readable = name, found, READABLE_FORMATS
        readable = ", ".join(map(str, READABLE_FORMATS))
        super().__init__(
            f"{printable(name)} has skill format {found}; this build reads format {readable}.", hint=hint
        )


class TooNewFormatError(UnsupportedFormatError):
    """Written by a later skillctl."""

    def __init__(self, name: str, found: int) -> None:
        super().__init__(name, found, "Upgrade skillctl (`pip install --upgrade skillctl`).")


class TooOldFormatError(UnsupportedFormatError):
    """Of a format that was never released, or is no longer read."""

    def __init__(self, name: str, found: int) -> None:
        super().__init__(name, found, "Make the skill again from its demonstrations.")


class UnsafeStoreError(ArtifactError):
    """A store with a symbolic link where a directory belongs: following it could write anywhere."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(
            f"{printable(name)} is a symbolic link; skillctl follows no links inside a store.",
            hint="Name the directory it points to with --store or SKILLCTL_STORE, or replace the link.",
        )


class InvalidRefsError(ArtifactError):
    """The aliases of a skill cannot be read: the file was changed by hand, or a merge left marks in it."""

    def __init__(self, name: str, reason: str) -> None:
        self.name, self.reason = name, reason
        super().__init__(
            f"the aliases in {printable(name)} cannot be read: {printable(reason)}.",
            hint="Below [aliases] a line is like `release = 3`. Correct it, or remove the file and tag anew.",
        )


class InvalidLockError(ArtifactError):
    """A lock file that cannot be read: it was changed by hand, or a merge left marks in it."""

    def __init__(self, name: str, reason: str) -> None:
        self.name, self.reason = name, reason
        super().__init__(
            f"the lock file {printable(name)} cannot be read: {printable(reason)}.",
            hint="Write it again with `skillctl lock SKILL…`, naming all skills that it shall hold.",
        )


class NotLockedError(ArtifactError):
    """A skill that the lock file does not name, or other content than it names."""


class InvalidSignaturesError(ArtifactError):
    """A file of signatures that cannot be read."""

    def __init__(self, name: str, reason: str) -> None:
        self.name, self.reason = name, reason
        super().__init__(
            f"the signatures in {printable(name)} cannot be read: {printable(reason)}.",
            hint="Get the file again from where it came from, or remove it and sign anew.",
        )


def require_format(name: str, found: object) -> None:
    """Raise unless ``found`` is a format version that this build reads.

    Raises:
        TooNewFormatError, TooOldFormatError: Another whole number.
        InvalidArtifactError: Missing, or not a whole number.
    """
    if type(found) is not int:  # True is an int, too
        readable = ", ".join(map(str, READABLE_FORMATS))
        shown = "no format version" if found is None else f"format version {str(found)[:40]!r}"
        raise InvalidArtifactError(
            name, f"it states {shown}, not a whole number; this build reads {readable}"
        )
    if found > max(READABLE_FORMATS):
        raise TooNewFormatError(name, found)
    if found < min(READABLE_FORMATS):
        raise TooOldFormatError(name, found)
