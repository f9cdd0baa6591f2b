"""What a reader may do with a spoiled artifact, and what it must not.

Nothing here shares code with the reader's checks: seals and rules are those of FORMAT.md.
"""

from __future__ import annotations

import hashlib
import re
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from skillctl import store
from skillctl.errors import ArtifactError, InputDataError, InvalidModelError, SkillctlError
from skillctl.model.chained import ChainedSkill
from skillctl.model.skill import Skill
from skillctl.stability.certificate import certify
from skillctl.store.errors import InvalidArtifactError, Refusal

SEAL = 512
NAME = "spoiled.h5"
CPU_LIMIT = 1.0  # [s] for reading one small file
HOLDS = re.compile(
    r"states (a kind|a digest) of \S+, but it holds (seds|merged|combined|chain|sha256:\w{64})"
)
MESSAGE_LIMIT = 500  # characters
DISTANCES = (0.0, 1e-9, 1.0, 1e9, 1e99, 1e200)  # from the attractor, at which there are gates and a density

REFUSED = "refused"
SAME = "accepted, same"
OTHER = "accepted, another skill"
UNCHANGED = "unchanged"
FINE = (REFUSED, SAME, OTHER, UNCHANGED)
# What must never happen.
CRASH, HANG, FOREIGN, SILENT, UNSOUND, SLOW, MUMBLED = (
    "CRASH", "HANG", "FOREIGN EXCEPTION", "SILENTLY DIFFERENT", "BREAKS A RULE", "SLOW", "BAD SENTENCE",
)  # fmt: skip
FAILURES = (CRASH, HANG, FOREIGN, SILENT, UNSOUND, SLOW, MUMBLED)


@dataclass(frozen=True)
class Verdict:
    outcome: str
    detail: str = ""


class Broken(Exception):  # noqa: N818 - not an error of a program but a finding
    def __init__(self, outcome: str, detail: str) -> None:
        super().__init__(detail)
        self.outcome = outcome


def seal(body: bytes, kind: str, digest: str, version: int = 2) -> bytes:
    lines = f"{version} {len(body)} {hashlib.sha256(body).hexdigest()}\n{kind} {digest}\n".encode()
    return (b"\x89SKILL\r\n\x1a\n" + lines).ljust(SEAL, b"\0") + body


def sealed_again(data: bytes, kind: str, digest: str, version: int) -> bytes:
    """Seal bytes as an attacker would who makes the seal state what the reader wants to see there."""
    for _ in range(2):
        again = seal(data[SEAL:], kind, digest, version)
        try:
            store.decode(again, NAME)
        except ArtifactError as error:
            wanted = HOLDS.search(str(error))
            if wanted is None:
                return again
            kind, digest = (wanted[2], digest) if wanted[1] == "a kind" else (kind, wanted[2])
        except Exception:  # to be judged, not here
            return again
    return seal(data[SEAL:], kind, digest, version)


def judge(data: bytes, good: bytes, *, prove: bool) -> Verdict:
    """Read ``data``, which was ``good`` once, and tell what came of it."""
    if data == good:
        return Verdict(UNCHANGED)
    start = time.process_time()
    try:
        verdict = _read(data, good, start, prove)
    except Broken as finding:
        return Verdict(finding.outcome, str(finding))
    except Exception:
        return Verdict(FOREIGN, traceback.format_exc(limit=-6))
    return verdict


def _read(data: bytes, good: bytes, start: float, prove: bool) -> Verdict:
    try:
        read = store.decode(data, NAME)
    except ArtifactError as error:
        _require_quick(start)
        _require_sentence(error)
        _require_known_cause(error)
        return Verdict(REFUSED, type(error).__name__)
    _require_quick(start)
    original = store.decode(good)
    if seal(data[SEAL:], *stated(data)) != data:
        raise Broken(SILENT, "a file was read whose seal does not fit")
    if store.digest_of(data, NAME) != read.digest:
        raise Broken(SILENT, "the two readers find different digests")
    same = _content(read) == _content(original)
    if same:
        # The same metadata in another spelling is another digest, never the same digest for other content.
        return Verdict(
            SAME, "same digest" if read.digest == original.digest else "metadata spelled otherwise"
        )
    if read.digest == original.digest:
        raise Broken(SILENT, f"different contents under one digest {read.digest}")
    _require_rules(read.skill)
    # A file of format 1 may lack results that the command of today always records.
    _require_writable(replace(read, operation=store.Operation(command="python")))
    if prove:
        _require_provable(read.skill)
    return Verdict(OTHER)


def stated(data: bytes) -> tuple[str, str, int]:
    """Return kind, digest and format version that the first 512 bytes state."""
    first, second = data[10:SEAL].decode("latin-1").split("\n")[:2]
    kind, digest = second.split(" ")
    return kind, digest, int(first.split(" ")[0])


def _require_quick(start: float) -> None:
    if (spent := time.process_time() - start) > CPU_LIMIT:
        raise Broken(SLOW, f"{spent:.2f} s of CPU")


def _require_sentence(error: ArtifactError) -> None:
    text = str(error)
    if not (
        text.startswith(f"{NAME} ")
        and text.endswith(".")
        and text.isprintable()
        and len(text) < MESSAGE_LIMIT
    ):
        raise Broken(MUMBLED, repr(text))
    if not error.hint or not error.hint.isprintable():
        raise Broken(MUMBLED, f"hint {error.hint!r}")


def _require_known_cause(error: ArtifactError) -> None:
    """Only what HDF5 itself raises may be called unreadable by HDF5; our own mistakes must not hide there."""
    cause = error.__cause__
    if cause is None or isinstance(cause, Refusal | InvalidModelError | InputDataError):
        return
    if not isinstance(error, InvalidArtifactError) or isinstance(cause, MemoryError | Warning):
        raise Broken(FOREIGN, f"{type(cause).__name__}: {cause}")
    innermost = traceback.extract_tb(cause.__traceback__)[-1].filename
    if "h5py" not in innermost:
        raise Broken(FOREIGN, "".join(traceback.format_exception(cause, limit=-5)))


def _content(artifact: store.Artifact) -> tuple[object, ...]:
    """Return what a digest is of: golden motions are no part of it."""
    arrays = {p: a for p, a in store.contents_of(artifact).items() if not p.startswith("golden/")}
    return store.metadata_of(artifact), {path: (a.shape, a.tobytes()) for path, a in arrays.items()}


def _matrices(skill: Skill) -> Iterator[tuple[str, np.ndarray]]:
    for leaf in skill.leaves:
        yield "covariances", leaf.covariances
        yield "residual_covariances", leaf.residual_covariances
        yield "density covariances", leaf.density.covariances
        yield "lyapunov", leaf.lyapunov[None]


def _require_rules(skill: Skill) -> None:
    """The rules that FORMAT.md gives for numbers, checked in another way than the model checks them."""
    for leaf in skill.leaves:
        for name, values in {"priors": leaf.priors, "density priors": leaf.density.priors}.items():
            if not ((values > 0).all() and abs(float(sum(values.tolist())) - 1) < 1e-9):
                raise Broken(UNSOUND, f"{name}: {values}")
        if not np.isfinite(leaf.system_matrices).all():
            raise Broken(UNSOUND, "system_matrices not finite")
        places = leaf.attractor + np.outer(DISTANCES, np.ones(leaf.dimension))
        with np.errstate(all="raise", under="ignore"):
            known, gates = leaf.density.log_density(places), leaf.responsibilities(places)
        if not (np.isfinite(known).all() and np.isfinite(gates).all()):
            raise Broken(UNSOUND, f"density {known} and gates {gates} away from the attractor")
    if isinstance(skill, ChainedSkill):
        _require_chain(skill)
    for name, matrices in _matrices(skill):
        if (matrices != matrices.swapaxes(1, 2)).any() or not (np.einsum("kii->ki", matrices) > 0).all():
            raise Broken(UNSOUND, f"{name}: {matrices}")
        scaled = matrices / np.abs(matrices).max(axis=(1, 2), keepdims=True)
        # Definite but for rounding: the smallest singular value with its sign, in units of the largest entry.
        if np.linalg.eigh(scaled)[0].min() < -16 * np.finfo(float).eps:
            raise Broken(UNSOUND, f"{name}: {matrices}")


def _require_chain(skill: ChainedSkill) -> None:
    """What the page says of a chain: one level and list of events a stage, and which stages there are."""
    if not len(skill.parts) == len(skill.levels) == len(skill.events):
        raise Broken(UNSOUND, f"{len(skill.parts)} stages, levels {skill.levels}, events {skill.events}")
    if not all(0 < float(level) < float("inf") for level in skill.levels):
        raise Broken(UNSOUND, f"levels {skill.levels}")
    if any(stage.kind == "chain" or stage.gate == "instantaneous" for stage in skill.parts):
        raise Broken(UNSOUND, "a stage is a chain or instantaneous")
    if skill.on_jump not in ("stay", "back") or not 0 < skill.disturbance_distance < float("inf"):
        raise Broken(UNSOUND, f"on a jump of {skill.disturbance_distance}: {skill.on_jump}")
    for event in (event for events in skill.events for event in events):
        if not re.fullmatch(r"[a-z][a-z0-9_-]{0,63}( [0-9.]{1,16})?", event):
            raise Broken(UNSOUND, f"event {event!r}")


def _require_writable(artifact: store.Artifact) -> None:
    first = store.encode(artifact)
    again = store.decode(first, NAME)
    if _content(again) != _content(artifact):
        raise Broken(SILENT, "what was read is written as something else")
    if store.encode(again) != first:
        raise Broken(SILENT, "writing what was read gives other bytes")


def _require_provable(skill: Skill) -> None:
    """Whatever was accepted, a proof is tried or refused in words."""
    try:
        certify(skill)
        with np.errstate(all="ignore"):
            skill.velocity(skill.leaves[0].means[0])
    except SkillctlError:
        pass
