"""Where a new skill goes: to a file, or into the store as the next version of a name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from skillctl.errors import ArtifactError, UsageError, printable, require_directory
from skillctl.store import (
    Artifact,
    Located,
    Registry,
    encode,
    locate_store,
    read_skill,
    require_outside_store,
    write_changed,
)
from skillctl.store.errors import LaterFeatureError, NotAnArtifactError, TooNewFormatError
from skillctl.store.schema import MAX_TEXT


@dataclass(frozen=True)
class Written:
    """A skill on disk.

    Attributes:
        skill: How to name it in the next command.
        path: Its file.
        digest: Its content digest.
        created: False if exactly this was there already.
    """

    skill: str
    path: Path
    digest: str
    created: bool


@dataclass(frozen=True)
class Destination:
    """Where a skill goes, and the note that it keeps.

    Attributes:
        file, name: One of them.
        store: Where the name lives; default as on the command line.
        note: Kept in the skill.
    """

    file: Path | None = None
    name: str | None = None
    store: str | Path | None = None
    note: str | None = None

    def __post_init__(self) -> None:
        if (self.file is None) == (self.name is None):
            raise UsageError(
                "there is no place to put the skill."
                if self.file is None
                else "-o and --name exclude each other.",
                hint="Give --name NAME to publish it in the store, or -o FILE.h5 to write a file.",
            )
        if self.note is not None and not 0 < len(printable(self.note)) <= MAX_TEXT:
            raise UsageError(
                f"a note has 1 to {MAX_TEXT} characters; this one has {len(self.note)}.",
                hint="Leave it out, or keep the long story elsewhere.",
            )

    @classmethod
    def at(
        cls, file: str | Path | None, name: str | None, store: str | Path | None, note: str | None
    ) -> Destination:
        """Return the destination for a file whose path may be given as text."""
        return cls(None if file is None else Path(file), name, store, note)

    def current(self) -> tuple[Artifact, Written] | None:
        """Return the skill that is there now, or None; a damaged file counts as none.

        Raises:
            UsageError: No skill can have this name; or the file must not be written: it would be among the
                versions of a store, or what is there is no skill, or one that only a later skillctl can use.
            StoreError: The file's directory does not exist.
        """
        located = self._located()
        if located is None:
            return None
        try:
            artifact = read_skill(located.path)
        except NotAnArtifactError as error:
            raise _kept(located.path, "is not a skill") from error
        except (LaterFeatureError, TooNewFormatError) as error:
            if self.file is None:  # the store gets one more version, and nothing is overwritten
                return None
            raise _kept(
                located.path, "is a skill that only a later skillctl can use", "Upgrade skillctl, or give"
            ) from error
        except ArtifactError:
            return None
        return artifact, Written(located.shown, located.path, artifact.digest, created=False)

    def write(self, artifact: Artifact) -> Written:
        """Write the artifact unless exactly this is there already."""
        if self.note is not None:
            noted = artifact.operation.model_copy(update={"note": printable(self.note)})
            artifact = replace(artifact, operation=noted)
        data = encode(artifact)
        place = self._place
        if isinstance(place, str):
            stored = Registry(locate_store(self.store)).publish(place, data)
            return Written(f"{place}@{stored.version}", stored.path, stored.digest, stored.created)
        return Written(str(place), place, artifact.digest, write_changed(place, data))

    @property
    def _place(self) -> Path | str:
        """The file or the name, whichever is given."""
        return self.name or "" if self.file is None else self.file

    def _located(self) -> Located | None:
        place = self._place
        if isinstance(place, str):
            registry = Registry(locate_store(self.store))
            versions = registry.versions(place)
            return registry.locate(f"{place}@{versions[-1]}") if versions else None
        require_outside_store(place, self.store)
        require_directory(place)
        return Located(place) if place.exists() else None


def _kept(path: Path, what: str, first: str = "Give") -> UsageError:
    return UsageError(
        f"{printable(str(path))} exists and {what}; it will not be overwritten.",
        hint=f"{first} another name after -o.",
    )
