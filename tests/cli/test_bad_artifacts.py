"""Artifacts that an attacker sealed again, damaged or unstable ones: refused in a sentence, or not proved."""

from __future__ import annotations

import hashlib
import json
import os
import resource
import subprocess
import sys
import time
from contextlib import suppress
from io import BytesIO

import h5py
import numpy as np
import pytest
from h5py import h5d, h5g, h5p, h5s, h5t

from skillctl.usecases.files import load

MEANS = "model/means"


def digest_by_the_page(file: BytesIO) -> str:
    digest = hashlib.sha256(b"skill-v2\n")
    with h5py.File(file) as body:
        arrays = {"meta.json": body["meta.json"]}
        for group in ("model", "demonstrations"):
            arrays |= {f"{group}/{name}": body[group][name] for name in body[group]}
        for path in sorted(arrays):
            kind = {"f": "<f8", "i": "<i8", "u": "<u1"}[arrays[path].dtype.kind]
            if arrays[path].nbytes > 1 << 20 or arrays[path].external:
                raise KeyError  # nothing that shall be read
            shape = ",".join(map(str, arrays[path].shape))
            digest.update(f"/{path} {kind} {shape}\n".encode() + arrays[path][()].astype(kind).tobytes())
    return f"sha256:{digest.hexdigest()}"


def resealed(good: bytes, edit) -> bytes:
    """Edit the body of an artifact and seal it as the format's page says, with its true digest if any."""
    file = BytesIO(good)
    with h5py.File(file, "r+") as body:
        edit(body)
    data = file.getvalue()[512:]
    with suppress(AttributeError, KeyError, OSError):
        digest = digest_by_the_page(file)
        lines = f"2 {len(data)} {hashlib.sha256(data).hexdigest()}\nseds {digest}\n".encode()
        return (good[:10] + lines).ljust(512, b"\0") + data
    stated = good[:512].split(b"\n")[3]  # kind and digest; the magic has two line feeds
    lines = f"2 {len(data)} {hashlib.sha256(data).hexdigest()}\n".encode() + stated + b"\n"
    return (good[:10] + lines).ljust(512, b"\0") + data


def instead(path, shape, kind=h5t.IEEE_F64LE, plist=None):
    """An edit that puts another dataset, without data, in the place of one."""

    def edit(body):
        del body[path]
        h5d.create(body.id, path.encode(), kind, h5s.create_simple(shape), plist)

    return edit


def bomb(body):
    del body[MEANS]
    body.create_dataset(MEANS, data=np.zeros((2**20, 4)), chunks=(2**20, 4), compression="gzip")


def overfull_chunk(body):
    """One chunk that inflates to far more than it claims to hold."""
    import zlib

    shape = body[MEANS].shape
    del body[MEANS]
    made = body.create_dataset(MEANS, shape, "<f8", chunks=shape, compression="gzip")
    made.id.write_direct_chunk((0, 0), zlib.compress(bytes(64 << 20)))


def external(path):
    plist = h5p.create(h5p.DATASET_CREATE)
    plist.set_external(os.fsencode(path), 0, 48)
    return instead(MEANS, (3, 2), plist=plist)


def linked(target):
    def edit(body):
        del body[MEANS]
        body[MEANS] = target

    return edit


def virtual(body):
    shape = body[MEANS].shape
    layout = h5py.VirtualLayout(shape, "<f8")
    layout[:] = h5py.VirtualSource("/etc/passwd", "data", shape)
    del body[MEANS]
    body.create_virtual_dataset(MEANS, layout)


def nested(body):
    group = body.id
    for _ in range(10_000):
        group = h5g.create(group, b"g")


def with_number(path, value):
    def edit(body):
        body[path][0] = value

    return edit


def with_meta(text):
    def edit(body):
        del body["meta.json"]
        body.create_dataset("meta.json", data=np.frombuffer(text, np.uint8))

    return edit


RESEALED = {
    "external link": linked(h5py.ExternalLink("/etc/passwd", "/")),
    "soft link": linked(h5py.SoftLink("/model/priors")),
    "external storage": external("/etc/passwd"),
    "virtual dataset": virtual,
    "the same object twice": lambda body: body.__setitem__("model/more", body["model/priors"]),
    "8 TiB": instead("demonstrations/positions", (2**39, 2)),
    "gzip bomb": bomb,
    "overfull chunk": overfull_chunk,
    "big-endian": instead(MEANS, (3, 2), h5t.IEEE_F64BE),
    "float32": instead(MEANS, (3, 2), h5t.IEEE_F32LE),
    "nested groups": nested,
    "a name to be obeyed": lambda body: body.create_dataset("model/\x1b[2J\n\u202e", data=np.zeros(1)),
    "extra dataset": lambda body: body.create_dataset("model/MEANS", data=np.zeros(1)),
    "missing dataset": lambda body: body.__delitem__("model/priors"),
    "not a number": with_number(MEANS, np.nan),
    "infinite": with_number("model/lyapunov", np.inf),
    "five axes": instead(MEANS, (1, 1, 1, 1, 1)),
    "scalar": lambda body: (body.__delitem__(MEANS), body.create_dataset(MEANS, data=np.float64(1))),
    "negative prior": with_number("model/priors", -0.1),
    "priors of another sum": lambda body: body["model/priors"].write_direct(body["model/priors"][()] + 1e-6),
    "not definite": with_number("model/covariances", -1.0),
    "metadata twice": with_meta(b'{"a": 1, "a": 2}'),
    "metadata too deep": with_meta(b"[" * 60_000),
    "a later format": with_meta(b'{"format": 2}'),
    "attribute": lambda body: body["model"].attrs.__setitem__("x", 1),
}


@pytest.mark.parametrize("name", RESEALED)
def test_a_resealed_file_is_refused_in_one_sentence(run, good, tmp_path, name):
    (path := tmp_path / "evil.h5").write_bytes(resealed(good, RESEALED[name]))
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    result = run("verify-stability", path)
    assert time.process_time() - began < 1  # [s]
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 40 << 10  # [KiB]; the bomb is larger
    assert result.exit_code == 7
    error, hint, *more = result.stderr.split("\n")
    assert (error.startswith(f"error: {path} "), hint.startswith("hint: "), more) == (True, True, [""])
    assert error.isprintable()
    assert "its seal states" not in error
    assert [entry.name for entry in tmp_path.iterdir()] == ["evil.h5"]


def test_the_files_that_are_refused_are_refused_for_what_was_changed(run, good, tmp_path):
    """Sealing again is done right: without a change the file is read."""
    (path := tmp_path / "same.h5").write_bytes(resealed(good, lambda body: None))
    assert run("verify-stability", path).exit_code == 0


def test_a_file_that_an_array_points_to_is_not_opened(good, tmp_path):
    """Whoever opens a pipe without a writer waits for ever: h5py does, and we must not."""
    os.mkfifo(tmp_path / "pipe")
    (path := tmp_path / "evil.h5").write_bytes(resealed(good, external(tmp_path / "pipe")))
    h5py_does = f"import h5py; h5py.File({str(path)!r})['{MEANS}'][()]"
    with pytest.raises(subprocess.TimeoutExpired):
        subprocess.run([sys.executable, "-c", h5py_does], check=False, timeout=5)
    command = [sys.executable, "-m", "skillctl", "inspect", str(path)]
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert result.returncode == 7
    assert "its data would come from another file" in result.stderr


@pytest.mark.parametrize("command", ["inspect", "export", "diff", "merge", "combine", "sign", "lock"])
def test_no_command_takes_a_damaged_file(run, good, library, tmp_path, monkeypatch, command):
    (path := tmp_path / "cut.h5").write_bytes(good[:-1])
    monkeypatch.chdir(tmp_path)
    key = tmp_path / "key.pem"
    more = {
        "export": ["-o", "out.json"],
        "diff": [library / "curve" / "1.h5"],
        "merge": [library / "curve" / "1.h5", "-o", "out.h5"],
        "combine": [library / "curve" / "1.h5", "-o", "out.h5"],
        "sign": ["--key", key],
    }
    if command == "sign":
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

        form = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
        key.write_bytes(Ed25519PrivateKey.generate().private_bytes(*form))
    before = sorted(tmp_path.iterdir())
    result = run(command, path, *more.get(command, []))
    assert (result.exit_code, result.stdout) == (7, "")
    assert result.stderr.startswith(f"error: {path} is damaged: cut short")
    assert sorted(tmp_path.iterdir()) == before


def test_what_stands_in_a_store_for_a_version_is_refused_at_once(run, good, tmp_path):
    (skill := tmp_path / "skills" / "reach").mkdir(parents=True)
    (target := tmp_path / "target.h5").write_bytes(good)
    (skill / "1.h5").mkdir()
    os.mkfifo(skill / "2.h5")
    (skill / "3.h5").symlink_to(target)
    (skill / "4.h5").symlink_to("/dev/zero")
    for version in range(1, 5):
        result = run("inspect", f"reach@{version}", "--store", tmp_path / "skills")
        assert (result.exit_code, result.stdout) == (7, ""), version
    (tmp_path / "skills" / "linked").symlink_to(skill)
    assert run("inspect", "linked@1", "--store", tmp_path / "skills").exit_code == 7
    assert run("ls", "--check", "--store", tmp_path / "skills").exit_code == 7


def test_a_refusal_as_json_is_one_document_without_control_characters(run, good, tmp_path):
    (path := tmp_path / "evil\x1b[2J.h5").write_bytes(good[:-1])
    result = run("inspect", path, "--json")
    assert (result.exit_code, result.stdout) == (7, "")
    assert "\x1b" not in result.stderr
    assert json.loads(result.stderr)["code"] == 7


# Verdicts


@pytest.mark.parametrize(
    "matrix",
    [
        np.zeros((2, 2)),  # exactly singular
        np.array([[0.0, 1.0], [-1.0, 0.0]]),  # turns for ever
        np.array([[-1.0, 1.0], [1.0, -1.0]]),  # singular in one direction
        np.array([[-1.0, 1.0], [1.0, -(1 - 2.0**-53)]]),  # its determinant is negative by less than rounding
        np.array([[-1.0, 0.0], [0.0, 1e-100]]),
    ],
    ids=["zero", "turns", "singular", "rounds to definite", "smallest positive"],
)
def test_what_is_almost_stable_is_read_and_not_proved(run, library, tmp_path, save_with_matrix, matrix):
    (leaf,) = load(library / "plain" / "1.h5").leaves
    assert (leaf.lyapunov == np.eye(2)).all()  # so the symmetric part of A decides
    path = save_with_matrix("plain", 0, matrix, tmp_path / "edge.h5")
    assert run("inspect", path).exit_code == 0
    result = run("verify-stability", path)
    assert (result.exit_code, result.stderr) == (1, "")
    assert "not proved" in result.stdout


def test_verification_names_exactly_the_bad_ones_of_ten(run, good, library, tmp_path):
    files = []
    for number in range(10):
        (path := tmp_path / f"{number}.h5").write_bytes(good)
        files.append(path)
    files[2].write_bytes(good[:-7])
    files[5].write_text("not a skill")
    files[7].write_bytes(resealed(good, with_number(MEANS, np.nan)))
    result = run("verify-stability", *files)
    assert result.exit_code == 7
    errors = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert [line.split()[1] for line in errors] == [str(files[number]) for number in (2, 5, 7)]
    rows = {line.split()[0]: line.split()[1] for line in result.stdout.splitlines()[1:]}
    bad = {str(files[number]) for number in (2, 5, 7)}
    assert rows == {str(path): "unreadable" if str(path) in bad else "stable" for path in files}


def test_the_surroundings_change_no_answer(good, tmp_path):
    (path := tmp_path / "skill.h5").write_bytes(good)
    (tmp_path / "elsewhere").mkdir()
    answers = set()
    for directory, changed in (
        (tmp_path, {}),
        (tmp_path / "elsewhere", {"HDF5_USE_FILE_LOCKING": "TRUE", "PYTHONHASHSEED": "7", "LC_ALL": "C"}),
        (tmp_path, {"HDF5_PLUGIN_PATH": str(tmp_path), "TZ": "Asia/Kathmandu", "PYTHONUTF8": "0"}),
    ):
        result = subprocess.run(
            [sys.executable, "-m", "skillctl", "verify-stability", str(path), "--json"],
            env={**os.environ, **changed},
            cwd=directory,
            capture_output=True,
            check=False,
            timeout=60,
        )
        assert (result.returncode, result.stderr) == (0, b"")
        answers.add(result.stdout)
    assert len(answers) == 1
