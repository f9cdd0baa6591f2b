"""What commands on one store have said, and whether it is true of what an independent reader finds there."""

from __future__ import annotations

import json
import re
import signal
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from independent import Folder

PUBLISHED = re.compile(r"([a-z0-9._-]+@\d+) was published")
REMOVED = re.compile(r"Removed before that: ([^.]*(?:\.[^ ][^.]*)*)\.")
UNSTARTED = re.compile(  # Python's, before our first line; or the soak's own, behind our last
    r"^Fatal Python error: init_|^Could not import runpy module|in _run_module_as_main\n"
    r"|in become\n +signal\."
)
MAKING = {"learn", "merge", "combine", "adapt", "chain"}
# Besides 0: what another process may have removed is not found (4), an alias may protect a version (2), and
# a lock may be out of date (1). A disk that refuses and a memory that is too small give 8.
ANSWERS = {"rm": {2, 4}, "lock": {1, 4}, "gc": {4}}
HINDERED = {"full disk": {8}, "small files": {8}, "little memory": {8}, "filled": {8}}
STOPPED = {"SIGKILL": {-9}, "SIGTERM": {143, -15}, "SIGINT": {130, -2}}


@dataclass
class Command:
    """One command that has ended.

    Attributes:
        words: What was typed after ``skillctl``.
        name: The skill that it makes, tags or removes; empty for all.
        note: Of the skill that it makes; no other command has it.
        trouble: What was done to it; empty for nothing.
        began, ended: When, [s].
        code: Exit code, or minus the signal that ended it.
        document: What it printed, if it is JSON.
        said: Its standard error.
    """

    words: list[str]
    name: str = ""
    note: str = ""
    trouble: str = ""
    began: float = 0.0
    ended: float = 0.0
    code: int = 0
    document: Any = None
    said: str = ""

    @property
    def verb(self) -> str:
        return self.words[0]

    @property
    def done(self) -> bool:
        """Whether it said that all was done."""
        return self.code == 0

    @property
    def told(self) -> bool:
        """Whether it could say what it had done, when it was stopped or hindered."""
        return self.code > 0

    def __str__(self) -> str:
        return f"`{' '.join(self.words)}` ({self.trouble or 'untroubled'}, code {self.code})"


@dataclass
class Promises:
    """All commands so far, and what follows from them.

    Attributes:
        commands: In no certain order.
        contents: Digest of every version that was ever seen or spoken of, by (name, number).
        findings: Sentences about broken promises, and how often each was found.
    """

    commands: list[Command] = field(default_factory=list)
    contents: dict[tuple[str, int], str] = field(default_factory=dict)
    findings: Counter[str] = field(default_factory=Counter)
    spoken: set[str] = field(default_factory=set)

    def find(self, what: str) -> None:
        """Note a finding; one of the same state of things counts once."""
        if what not in self.spoken:
            self.spoken.add(what)
            print(f"FOUND: {what}", flush=True)
            self.findings[re.sub(r"[0-9a-f]{8,}|\d+", "N", what)] += 1

    def judge(self, command: Command, full: bool) -> None:
        """Judge a command by itself.

        Args:
            command: It has ended.
            full: Whether the disk may have been full meanwhile.
        """
        self.commands.append(command)
        if command.code in (1, -signal.SIGINT) and UNSTARTED.search(command.said):
            return
        trouble = command.trouble.partition(" ")[0] if command.trouble.startswith("SIG") else command.trouble
        allowed = {0, 4} | ANSWERS.get(command.verb, set()) | ({8} if full else set())
        allowed |= HINDERED.get(trouble, set()) | STOPPED.get(trouble, set())
        if command.verb == "learn":
            allowed -= {4}
        if command.code not in allowed:
            self.find(f"{command} ended with {command.code}: {command.said[:600]}")
        if "Traceback" in command.said:
            self.find(f"{command} printed a traceback: {command.said[-600:]}")
        if command.done and command.document is None:
            self.find(f"{command} ended with 0, and its document is none")
        unwritable = command.trouble == "small files" and not command.said
        if command.code >= 2 and not unwritable and not _is_failure(command):
            self.find(f"{command} did not say its failure as a document: {command.said[:600]}")
        for name, number, digest in _stated(command.document):
            self._know(name, number, digest, f"{command}")

    def _know(self, name: str, number: int, digest: str, who: str) -> None:
        if self.contents.setdefault((name, number), digest) != digest:
            self.find(f"{name}@{number} had another content before, after {who}")

    def compare(self, store: dict[str, Folder]) -> None:
        """Compare a store, to which nobody is writing, with all that was said about it."""
        for name, folder in store.items():
            for number, artifact in folder.versions.items():
                self._know(name, number, artifact.digest, "a look at the disk")
            for alias, number in folder.aliases.items():
                if number not in folder.versions:
                    self.find(f"{name}@{alias} is version {number}, which is not there")
        self._require_publications(store)
        self._require_removals(store)
        self._require_aliases(store)

    def _require_publications(self, store: dict[str, Folder]) -> None:
        there = {
            artifact.note: f"{name}@{number}"
            for name, folder in store.items()
            for number, artifact in folder.versions.items()
        }
        gone = {skill for command in self.commands for skill in removed_by(command)}
        for command in filter(lambda each: each.verb in MAKING and each.note, self.commands):
            skill, found = published_by(command), there.get(command.note)
            if found and command.told and not skill:
                self.find(f"{command} published {found} and did not say so: {command.said}")
            maybe = gone | {found}
            if skill and skill not in maybe and not self._maybe_removed(skill, command, store):
                self.find(f"{command} published {skill}, and there is {found}")

    def _maybe_removed(self, skill: str, maker: Command, store: dict[str, Folder]) -> bool:
        """Whether a command that could not say what it had done may have removed a version."""
        name, _, number = skill.partition("@")
        higher = store[name].given - int(number) if name in store else 0
        return any(
            command.ended > maker.began
            and (command.name or name) == name
            and (command.verb == "gc" or "--all" in command.words or skill in command.words)
            and (command.verb != "gc" or higher >= kept_by(command))
            for command in self.commands
            if command.verb in ("rm", "gc") and not command.done and not told_removal(command)
        )

    def _require_removals(self, store: dict[str, Folder]) -> None:
        for command in self.commands:
            for skill in removed_by(command):
                name, _, number = skill.partition("@")
                if name in store and number.isdigit() and int(number) in store[name].versions:
                    self.find(f"{command} removed {skill}, and it is there")
            if command.done and (command.verb == "rm" or "--keep-tagged" in command.words):
                for each in (command.document or {}).get("removed", ()):
                    if each["aliases"] and "--force" not in command.words:
                        self.find(f"{command} removed {each['skill']}, which had aliases: {each['aliases']}")

    def _require_aliases(self, store: dict[str, Folder]) -> None:
        """Each alias is as the last command left it, or as one that could not say may have."""
        for name, alias in {(each.name, each.words[-1]) for each in self.commands if each.verb in TAGGING}:
            found = store[name].aliases.get(alias) if name in store else None
            changes = [(0.0, 0.0, True, None), *self._changes(name, alias)]
            last = max(began for began, _, sure, _ in changes if sure)
            possible = {value for _, ended, _, value in changes if ended >= last}
            if found not in possible:
                self.find(f"{name}@{alias} is {found}, not one of {possible}")

    def _changes(self, name: str, alias: str) -> list[tuple[float, float, bool, int | None]]:
        """Return when an alias was, or may have been, changed, whether it surely was, and to what."""
        found = []
        for command in self.commands:
            times = command.began, command.ended
            if command.verb in TAGGING and (command.name, command.words[-1]) == (name, alias):
                for value in _tagged(command):
                    found.append((*times, command.done, value))
            elif command.verb in ("rm", "gc") and (command.name or name) == name:
                sure = f"{name}@{alias}" in removed_by(command)
                if sure or not (command.done or told_removal(command)):
                    found.append((*times, sure, None))
        return found


TAGGING = ("tag", "untag")


def kept_by(command: Command) -> int:
    return int(command.words[command.words.index("--keep-last") + 1])


def published_by(command: Command) -> str:
    """Return the version that a command says it has published; nothing if none."""
    if command.done:
        written = (command.document or {}).get("written") or {}
        return str(written.get("skill", "")) if written.get("created") else ""
    said = PUBLISHED.search(command.said)
    return said[1] if said else ""


def told_removal(command: Command) -> bool:
    """Whether a command that removes, and did not end well, has said what it had removed."""
    return command.code in (2, 4, 8) and "standard output" not in command.said  # where it would have said so


def removed_by(command: Command) -> set[str]:
    """Return the versions and aliases that a command says it has removed."""
    if command.verb not in ("rm", "gc"):
        return set()
    if command.done:
        removed = (command.document or {}).get("removed", ())
        names = {each["skill"].partition("@")[0] + "@" + word for each in removed for word in each["aliases"]}
        return names | {each["skill"] for each in removed}
    try:
        message = json.loads(command.said)["message"]
    except (ValueError, TypeError, KeyError):
        message = command.said
    return {skill for said in REMOVED.findall(message) for skill in said.split(", ")}


def _tagged(command: Command) -> list[int | None]:
    """Return what a command made of its alias, or may have made of it."""
    if command.code in (2, 4):
        return []
    if command.verb == "untag":
        return [None]
    if command.done:
        return [int(command.document["skill"].partition("@")[2])]
    return [int(command.words[1].partition("@")[2])]


def _is_failure(command: Command) -> bool:
    try:
        return bool(json.loads(command.said)["code"] == command.code)
    except (ValueError, KeyError, TypeError):
        return False


def _stated(document: Any) -> list[tuple[str, int, str]]:
    """Return what a document states of contents: (name, number, digest)."""
    found = []
    if isinstance(document, list):
        return [each for item in document for each in _stated(item)]
    if not isinstance(document, dict):
        return []
    name, _, number = str(document.get("skill", "")).partition("@")
    digest = document.get("digest")
    if number.isdigit() and isinstance(digest, str):
        found.append((name, int(number), digest))
    if isinstance(document.get("version"), int) and isinstance(document.get("name"), str) and digest:
        found.append((document["name"], document["version"], digest))
    entries = document.get("entries")
    if isinstance(entries, list) and isinstance(document.get("name"), str):
        return [
            *found,
            *((document["name"], each["version"], each["digest"]) for each in entries if each.get("digest")),
        ]
    return [*found, *(each for value in document.values() for each in _stated(value))]
