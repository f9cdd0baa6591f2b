"""Why a file is refused: one class for each thing that a caller can do about it."""

from __future__ import annotations

from typing import ClassVar

from skillctl.errors import ArtifactError, printable

_UPGRADE = "Upgrade skillctl."


class Refusal(Exception):  # noqa: N818 - not an error by itself: the reader adds the file's name
    """A reason to refuse a file, raised where the file's name is not known."""


class LaterFeature(Refusal):
    """A part of the format that is reserved: a later skillctl writes it, and this build cannot use it."""


class RefusedFileError(ArtifactError):
    """A file and the reason to refuse it; each class has its own sentence and hint for both."""

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


class TooNewFormatError(RefusedFileError):
    """An artifact of a format version that a later skillctl writes."""

    sentence = "{name} has skill format {reason}."
    advice = _UPGRADE


class TooOldFormatError(RefusedFileError):
    """An artifact of a format version that was never released, or is no longer read."""

    sentence = "{name} has skill format {reason}."
    advice = "Make the skill again from its demonstrations."


class UnsafeStoreError(RefusedFileError):
    """A store with a symbolic link where a directory belongs: following it could write anywhere."""

    sentence = "{name} is {reason}; skillctl follows no links inside a store."
    advice = "Put the directory itself in the place of the link, or name its own store with --store."


class NotLockedError(ArtifactError):
    """A skill that the lock file does not name, or other content than it names."""
