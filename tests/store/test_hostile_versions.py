"""Files whose seal, metadata or body state what they do not hold, or another version of the format."""

import json

import numpy as np
import pytest

from skillctl import store
from skillctl.store import errors

# What the seal states


@pytest.mark.parametrize("kind", ["seds", "merged"])
def test_a_seal_that_states_another_kind(refuse, good, reseal, page_digest, kind):
    digest = page_digest(good[512:])
    assert reseal(good[512:], "combined", digest) == good
    refuse(reseal(good[512:], kind, digest), f"its seal states a kind of {kind}, but it holds combined")


def test_a_seal_that_states_another_digest(refuse, good, reseal):
    data = reseal(good[512:])
    refuse(data, f"its seal states a digest of sha256:{'0' * 64}, but it holds sha256:")
    with pytest.raises(errors.InvalidArtifactError, match="states a digest"):
        store.digest_of(data)


# Format versions


@pytest.mark.parametrize(
    ("version", "kind", "cause"),
    [
        (3, errors.TooNewFormatError, "has skill format 3; this build reads formats 1, 2"),
        (999, errors.TooNewFormatError, "has skill format 999; this build reads formats 1, 2"),
        (0, errors.TooOldFormatError, "has skill format 0; this build reads formats 1, 2"),
        (1, errors.InvalidArtifactError, "/meta.json: format: must be 2, as its seal states"),
        (
            "1.0",
            errors.InvalidArtifactError,
            "format version '1.0', not a whole number; this build reads formats 1, 2",
        ),
        (
            1.0,
            errors.InvalidArtifactError,
            "format version '1.0', not a whole number; this build reads formats 1, 2",
        ),
        (
            True,
            errors.InvalidArtifactError,
            "format version 'True', not a whole number; this build reads formats 1, 2",
        ),
        (
            None,
            errors.InvalidArtifactError,
            "no format version, not a whole number; this build reads formats 1, 2",
        ),
        ("\x1b[2J" * 99, errors.InvalidArtifactError, "not a whole number; this build reads formats 1, 2"),
    ],
)
def test_versions_in_the_metadata(refuse, with_meta, meta, version, kind, cause):
    refuse(with_meta(json.dumps({**meta, "format": version}).encode()), cause, kind)


def test_a_missing_version_in_the_metadata(refuse, with_meta, meta):
    del (without := dict(meta))["format"]
    refuse(with_meta(json.dumps(without).encode()), "states no format version")


@pytest.mark.parametrize(
    ("mark", "kind", "cause"),
    [
        (
            np.bytes_("skill-v3"),
            errors.TooNewFormatError,
            "has skill format 3; this build reads formats 1, 2",
        ),
        (
            np.bytes_("skill-v0"),
            errors.TooOldFormatError,
            "has skill format 0; this build reads formats 1, 2",
        ),
        (np.bytes_("skill-v1"), errors.InvalidArtifactError, "must be skill-v2, as its seal states"),
        (np.bytes_("skill-v1.0"), errors.InvalidArtifactError, "'skill-v1.0', not a whole number"),
        (np.bytes_("skill-v01"), errors.InvalidArtifactError, "must be skill-v2"),
        (np.bytes_("\x1b[2J"), errors.InvalidArtifactError, "not a whole number"),
        (np.bytes_("x" * 1000), errors.InvalidArtifactError, "short text of fixed length"),
        ("skill-v2", errors.InvalidArtifactError, "short text of fixed length"),
        (1, errors.InvalidArtifactError, "short text of fixed length"),
        (np.array([b"skill-v2"]), errors.InvalidArtifactError, "short text of fixed length"),
        (None, errors.InvalidArtifactError, "must have one attribute"),
    ],
)
def test_versions_in_the_body(refuse, hostile, mark, kind, cause):
    def edit(body):
        del body.attrs["format"]
        if mark is not None:
            body.attrs["format"] = mark

    refuse(hostile(edit), cause, kind)


@pytest.mark.parametrize(
    ("version", "kind", "cause"),
    [
        (b"3", errors.TooNewFormatError, "has skill format 3; this build reads formats 1, 2"),
        (b"0", errors.TooOldFormatError, "has skill format 0; this build reads formats 1, 2"),
        (b"1", errors.InvalidArtifactError, "must be skill-v1, as its seal states"),
        (b"02", errors.DamagedArtifactError, "do not match its seal"),
        (b"2.0", errors.DamagedArtifactError, "are not a seal"),
        (b"", errors.DamagedArtifactError, "are not a seal"),
    ],
)
def test_versions_in_the_seal(good, version, kind, cause):
    head = good[:10] + version + good[11:]
    data = head[:512] + good[512:] if len(head) <= len(good) else head[:511] + b"\0" + good[512:]
    with pytest.raises(kind, match=cause):
        store.decode(data.ljust(len(good), b"\0"), "later.h5")
