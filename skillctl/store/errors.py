"""Why a file was refused: one class for each thing a caller may want to do about it."""

from __future__ import annotations

from typing import ClassVar

from skillctl.errors import ArtifactError, printable

_UPGRADE = "Upgrade skillctl."


class Refusal(Exception):  # noqa: N818 - not an error of its own: the reader adds the file's name
    """A reason to refuse a file, raised where the file's name is not known."""


class LaterFeature(Refusal):
    """A part of the format that is reserved: a later skillctl writes it, and this build cannot use it."""


class RefusedFileError(ArtifactError):
    """A file and the reason to refuse it; each class below says both in its own sentence."""

    sentence: ClassVar[str]
    advice: ClassVar[str]

    def __init__(self, name: str, reason: str, *, hint: str = "") -> None:
        self.name, self.reason = name, reason
        super().__init__(
            self.sentence.format(name=printable(name), reason=printable(reason)), hint=hint or self.advice
        )


class NotAnArtifactError(RefusedFileError):
    """Something else than a skill artifact: another file format, an empty file, a directory, a link."""

    sentence = "{name} is not a skill artifact: {reason}."
    advice = "Make one with `skillctl learn DATA -o FILE.h5`."


class DamagedArtifactError(RefusedFileError):
    """An artifact whose bytes are not the ones that were written."""

    sentence = "{name} is damaged: {reason}."
    advice = "Copy it again from where it came from (in binary mode), or make it again from its inputs."


class InvalidArtifactError(RefusedFileError):
    """A sealed file whose contents break a rule of the format: it was not written by skillctl."""

    sentence = "{name} is not a valid skill artifact: {reason}."
    advice = "Its seal is intact, so it was written like this; do not use it, ask whoever made it."


class LaterFeatureError(RefusedFileError):
    """An artifact of a format that this build reads, with a part that only a later skillctl can use."""

    sentence = "{name} uses {reason}, which a later skillctl writes; this build cannot use it."
    advice = _UPGRADE


class InvalidRefsError(RefusedFileError):
    """The aliases of a skill cannot be read: the file was changed by hand, or a merge left marks in it."""

    sentence = "the aliases in {name} cannot be read: {reason}."
    advice = "Below [aliases] a line is like `release = 3`. Correct it, or remove the file and tag anew."


class InvalidLockError(RefusedFileError):
    """A lock file that cannot be read: it was changed by hand, or a merge left marks in it."""

    sentence = "the lock file {name} cannot be read: {reason}."
    advice = "Write it again with `skillctl lock SKILL…`, naming all skills that it shall hold."


class InvalidSignaturesError(RefusedFileError):
    """A file of signatures that cannot be read."""

    sentence = "the signatures in {name} cannot be read: {reason}."
    advice = "Get the file again from where it came from, or remove it and sign anew."


class UnsupportedFormatError(ArtifactError):
    """An artifact of a format version that this build does not read."""

    advice: ClassVar[str]

    def __init__(self, name: str, found: int, readable: tuple[int, ...]) -> None:
        self.name, self.found, self.readable = name, found, readable
        super().__init__(
            f"{printable(name)} has skill format {found}; this build reads {formats(readable)}.",
            hint=self.advice,
        )


class TooNewFormatError(UnsupportedFormatError):
    """Written by a later skillctl."""

    advice = _UPGRADE


class TooOldFormatError(UnsupportedFormatError):
    """Of a format that was never released, or is no longer read."""

    advice = "Make the skill again from its demonstrations."


class UnsafeStoreError(ArtifactError):
    """A store with a symbolic link where a directory belongs: following it could write anywhere."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(
            f"{printable(name)} is a symbolic link; skillctl follows no links inside a store.",
            hint="Name the directory it points to with --store or SKILLCTL_STORE, or replace the link.",
        )


class NotLockedError(ArtifactError):
    """A skill that the lock file does not name, or other content than it names."""


def formats(versions: tuple[int, ...]) -> str:
    """Return ``formats 1, 2``."""
    return f"format{'s' if len(versions) > 1 else ''} {', '.join(map(str, versions))}"
