"""Where a new skill goes: a file, or the next version of a name in the store."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from skillctl.errors import ArtifactError, UsageError, printable, require_directory
from skillctl.store import Artifact, Located, Registry, encode, locate_store, read_skill, write_file
from skillctl.store.errors import NotAnArtifactError
from skillctl.store.schema import MAX_TEXT
from skillctl.store.source import display_name


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
    """Where a skill goes, and what is to be remembered about it.

    Attributes:
        file, name: One of them.
        store: Where the name lives; None: found as for every command.
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
        """Return what lies there now, or None; a damaged artifact counts as nothing.

        Raises:
            UsageError: No skill can be called so, or the file is something else than a skill: it shall not
                be overwritten.
            StoreError: The file's directory does not exist.
        """
        located = self._located()
        if located is None:
            return None
        try:
            artifact = read_skill(located.path)
        except NotAnArtifactError as error:
            raise UsageError(
                f"{located.path} exists and is not a skill; it will not be overwritten.",
                hint="Give another name after -o, or remove the file.",
            ) from error
        except ArtifactError:
            return None
        return artifact, Written(display_name(located), located.path, artifact.digest, created=False)

    def write(self, artifact: Artifact) -> Written:
        """Write the artifact, or find that exactly it is there already."""
        if self.note is not None:
            noted = artifact.operation.model_copy(update={"note": printable(self.note)})
            artifact = replace(artifact, operation=noted)
        data = encode(artifact)
        if self.name is not None:
            stored = Registry(locate_store(self.store)).publish(self.name, data)
            located = Located(stored.path, stored.name, stored.version)
            return Written(display_name(located), stored.path, stored.digest, stored.created)
        assert self.file is not None  # by construction
        same = self.file.is_file() and self.file.read_bytes() == data
        if not same:
            write_file(self.file, data)
        return Written(str(self.file), self.file, artifact.digest, not same)

    def _located(self) -> Located | None:
        if self.name is not None:
            registry = Registry(locate_store(self.store))
            versions = registry.versions(self.name)
            return registry.locate(f"{self.name}@{versions[-1]}") if versions else None
        assert self.file is not None  # by construction
        require_directory(self.file)
        return Located(self.file) if self.file.exists() else None
