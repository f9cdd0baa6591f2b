"""The first 512 bytes tell a list what it needs, without the rest."""

import pytest

from skillctl import store
from skillctl.errors import ArtifactError
from skillctl.store import errors


def test_the_header_states_kind_digest_and_size(artifact, tmp_path):
    data = store.encode(artifact)
    (path := tmp_path / "skill.h5").write_bytes(data)
    header = store.read_header(path)
    kinds = {
        "SedsSkill": "seds",
        "MergedSkill": "merged",
        "CombinedSkill": "combined",
        "ChainedSkill": "chain",
    }
    assert header.kind == kinds[type(artifact.skill).__name__]
    assert header.digest == artifact.digest
    assert header.body_bytes == len(data) - 512


def test_a_header_is_read_without_the_rest(good, tmp_path):
    path = tmp_path / "skill.h5"
    path.write_bytes(good[:-1] + bytes([good[-1] ^ 1]))
    assert store.read_header(path).kind == "combined"
    with pytest.raises(errors.DamagedArtifactError):
        store.read_skill(path)


@pytest.mark.parametrize("length", [0, 5, 10, 100, 511, 512, 2000])
def test_a_file_that_was_cut_is_noticed_by_its_header(good, tmp_path, length):
    (path := tmp_path / "skill.h5").write_bytes(good[:length])
    with pytest.raises(ArtifactError):
        store.read_header(path)


def test_a_header_of_another_format_or_kind_is_refused(good, tmp_path):
    path = tmp_path / "skill.h5"
    path.write_bytes(good.replace(b"\n2 ", b"\n3 ", 1))
    with pytest.raises(errors.TooNewFormatError):
        store.read_header(path)
    path.write_bytes(good.replace(b"combined sha256", b"compiled sha256", 1))
    with pytest.raises(errors.DamagedArtifactError):
        store.read_header(path)
    head = good[:512].replace(b"\n2 ", b"\n1 ", 1).replace(b"combined sha256", b"chain sha256", 1)
    path.write_bytes(head.ljust(512, b"\0") + good[512:])
    with pytest.raises(errors.InvalidArtifactError, match="format 1 has no skills of kind chain"):
        store.read_header(path)
