"""Bad artifacts and bad stores at the command line: one sentence, the right exit code, nothing written.

The rooms' own tests try each kind in depth; `HELD_BY` says which hold what.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import h5py
import numpy as np
import pytest
from h5py import h5d, h5g, h5p, h5s, h5t

from skillctl import store
from skillctl.usecases.files import load, save

TESTS = Path(__file__).parents[1]
MEANS = "model/means"

HELD_BY = {
    "a flipped bit": "store/test_damage.py::test_every_bit_of_the_seal_and_samples_of_the_body_count",
    "cut at any length": "store/test_damage.py::test_every_truncation_is_refused",
    "bytes appended": "store/test_damage.py::test_appended_bytes_are_refused",
    "blocks zeroed or swapped": "store/test_damage.py::test_zeroed_and_swapped_blocks_are_refused",
    "another format": "store/test_damage.py::test_another_file_is_called_what_it_is",
    "HDF5 without a seal": "store/test_damage.py::test_a_plain_hdf5_body_without_its_seal_is_refused",
    "a text-mode transfer": "store/test_damage.py::test_a_text_mode_transfer_is_recognised",
    "no regular file": "store/test_damage.py::test_what_is_not_a_regular_file_is_refused_at_once",
    "10 GiB": "store/test_damage.py::test_a_huge_file_is_refused_by_its_size",
    "links": "store/test_hostile.py::test_links_and_objects",
    "a user-defined link": "store/test_hostile.py::test_a_user_defined_link",
    "external storage": "store/test_hostile.py::test_external_storage_is_never_opened",
    "external storage, unwatched": "HERE::test_a_file_that_an_array_points_to_is_not_opened",
    "virtual, chunked, filtered": "store/test_hostile.py::test_storage",
    "terabytes declared": "store/test_processes.py::test_a_hostile_file_costs_little_memory",
    "many large arrays": "store/test_hostile.py::test_all_arrays_together_are_limited",
    "a thousand datasets": "store/test_hostile.py::test_a_thousand_datasets_are_refused_unread",
    "a compressed bomb": "HERE::test_a_resealed_file_is_refused_in_one_sentence",
    "a planted plugin": "store/test_hostile.py::test_a_planted_filter_plugin_is_not_loaded",
    "element types": "store/test_hostile.py::test_element_types",
    "integer types": "store/test_hostile.py::test_integer_types",
    "groups, members, attributes by the thousand": "store/test_hostile.py::test_amounts",
    "names": "store/test_hostile.py::test_names",
    "missing members": "store/test_hostile.py::test_missing_members",
    "not finite": "store/test_hostile.py::test_numbers_must_be_finite",
    "shapes": "store/test_hostile.py::test_shapes",
    "priors and covariances": "store/test_hostile.py::test_numbers_must_form_a_skill",
    "barely unstable": "HERE::test_what_is_almost_stable_is_read_and_not_proved",
    "metadata": "store/test_hostile.py::test_metadata_is_strict_json",
    "format versions": "store/test_hostile.py::test_versions_in_the_seal",
    "names of skills": "store/test_references.py::test_names_that_are_refused",
    "references": "HERE::test_references_that_are_malformed_or_lead_nowhere",
    "full, read-only and inode-less disks": (
        "store/test_interrupts.py::test_on_a_disk_that_refuses_old_versions_stay_whole_and_nothing_is_left"
    ),
    "no permission": "HERE::test_without_permission_nothing_changes",
    "a limit on the size of files": "HERE::test_under_a_limit_on_the_size_of_files_nothing_changes",
    "a link for a directory": (
        "store/test_registry.py::test_a_link_in_place_of_a_skills_directory_is_not_followed"
    ),
    "a link for a version": "store/test_registry.py::test_a_planted_version_link_is_passed_over",
    "writers at once": (
        "store/test_processes.py::test_eight_writers_at_once_get_unique_numbers_without_gaps"
    ),
    "killed writers": (
        "store/test_processes.py::test_a_killed_writer_loses_nothing_it_reported_and_leaves_nothing_half"
    ),
    "SIGINT and SIGTERM": (
        "store/test_interrupts.py::test_a_signal_while_publishing_is_answered_on_standard_error"
    ),
    "a closed pipe": "cli/test_frame.py::test_a_closed_pipe_exits_141_in_silence",
    "a full standard output": "cli/test_frame.py::test_a_full_disk_under_standard_output_is_not_success",
    "three bad files of ten": "HERE::test_verification_names_exactly_the_bad_ones_of_ten",
    "the same bytes anywhere": (
        "store/test_processes.py::test_the_same_content_gives_the_same_bytes_in_any_process"
    ),
    "the same answer anywhere": "HERE::test_the_surroundings_change_no_answer",
    "HDF5 that hangs the library": (
        "demonstrations/test_robomimic.py::test_a_file_that_libhdf5_never_finishes_is_given_up"
    ),
    "parsers that crash": "demonstrations/test_child.py::test_whatever_a_parser_does_ends_in_a_sentence",
    "a file swapped while it is read": (
        "store/test_damage.py::test_a_file_swapped_after_it_was_opened_changes_nothing"
    ),
}


def test_every_bad_input_has_its_test():
    for what, place in HELD_BY.items():
        path, name = place.split("::")
        source = Path(__file__) if path == "HERE" else TESTS / path
        tree = ast.parse(source.read_text(encoding="utf-8"))
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, what


# ---------------------------------------------------------------------------------------------------------
# Files that an attacker sealed again


def digest_by_the_page(file: BytesIO) -> str:
    digest = hashlib.sha256(b"skill-v1\n")
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
        lines = f"1 {len(data)} {hashlib.sha256(data).hexdigest()}\nseds {digest}\n".encode()
        return (good[:10] + lines).ljust(512, b"\0") + data
    stated = good[:512].split(b"\n")[3]  # kind and digest; the magic has two line feeds
    lines = f"1 {len(data)} {hashlib.sha256(data).hexdigest()}\n".encode() + stated + b"\n"
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


@pytest.fixture(scope="module")
def good(library):
    return (library / "curve" / "1.h5").read_bytes()


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


# ---------------------------------------------------------------------------------------------------------
# Verdicts


@pytest.mark.parametrize(
    "matrix",
    [
        np.zeros((2, 2)),  # exactly singular
        np.array([[0.0, 1.0], [-1.0, 0.0]]),  # turns for ever
        np.array([[-1.0, 1.0], [1.0, -1.0]]),  # singular in one direction
        np.array([[-1.0, 1.0], [1.0, -(1 - 2.0**-53)]]),  # its determinant is negative by less than rounding
        np.array([[-1.0, 0.0], [0.0, 5e-324]]),
    ],
    ids=["zero", "turns", "singular", "rounds to definite", "smallest positive"],
)
def test_what_is_almost_stable_is_read_and_not_proved(run, library, tmp_path, matrix):
    skill = load("plain", store=library)  # P = I, so the symmetric part of A decides
    assert (skill.lyapunov == np.eye(2)).all()
    matrices = skill.system_matrices.copy()
    matrices[0] = matrix
    path = save(replace(skill, system_matrices=matrices), tmp_path / "edge.h5")
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


# ---------------------------------------------------------------------------------------------------------
# Stores


@pytest.mark.parametrize(
    ("reference", "code"),
    [
        ("reach@0", 2),
        ("reach@-1", 2),
        ("reach@1e3", 2),
        ("reach@1000000", 2),
        ("reach@", 2),
        ("Reach", 2),
        (".", 2),
        ("", 2),
        ("rea\nch", 2),
        ("x" * 65, 2),
        ("../x", 4),  # a slash makes it a file
        ("empty", 4),
        ("empty@latest", 4),
        ("reach@2", 4),
        ("reach@999999", 4),
        ("reach@release", 4),
        (f"reach@sha256:{'0' * 64}", 4),
    ],
)
def test_references_that_are_malformed_or_lead_nowhere(run, good, tmp_path, reference, code):
    store.Registry(tmp_path / "skills").publish("reach", good)
    (tmp_path / "skills" / "empty").mkdir()
    result = run("inspect", "--store", tmp_path / "skills", "--", reference)
    assert (result.exit_code, result.stdout) == (code, "")
    error, hint = result.stderr.splitlines()
    assert error.startswith("error: ")
    assert hint.startswith("hint: ")


@pytest.fixture
def registry(library, tmp_path):
    """A store of curve and hook, and both, whose newest version is about to get a successor."""
    registry = store.Registry(tmp_path / "skills")
    for name, source in (("curve", "curve"), ("hook", "hook"), ("both", "curve")):
        registry.publish(name, (library / source / "1.h5").read_bytes())
    return registry


def combine(registry, place, prefix=(), **options):
    arguments = ["combine", "curve", "hook", "--store", registry.root, *place]
    command = [*prefix, sys.executable, "-m", "skillctl", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60, **options)


def files_of(registry):
    return {path: path.read_bytes() for path in registry.root.rglob("*") if path.is_file()}


def test_without_permission_nothing_changes(registry):
    prefix = []
    if os.geteuid() == 0:  # root has no need of permissions, unless it gives that up
        prefix = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"]
        if shutil.which("setpriv") is None or subprocess.run([*prefix, "true"], check=False).returncode:
            pytest.skip("root cannot give up its rights here")
    before, folders = files_of(registry), [registry.root, *registry.root.iterdir()]
    for folder in folders:
        folder.chmod(0o555)
    try:
        for place in (["--name", "both"], ["--name", "new"], ["-o", registry.root / "out.h5"]):
            result = combine(registry, place, prefix)
            assert (result.returncode, result.stdout) == (8, "")
            assert "Permission denied" in result.stderr
            assert "\nhint: Check the permissions" in result.stderr
    finally:
        for folder in folders:
            folder.chmod(0o755)
    assert files_of(registry) == before


def test_under_a_limit_on_the_size_of_files_nothing_changes(registry):
    before = files_of(registry)
    for place in (["--name", "both"], ["--name", "new"], ["-o", registry.root / "out.h5"]):
        limited = combine(
            registry, place, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        )
        assert (limited.returncode, limited.stdout) == (8, "")
        assert "File too large" in limited.stderr
        assert "\nhint: The limit on file sizes" in limited.stderr
    assert files_of(registry) == before


def test_a_refusal_as_json_is_one_document_without_control_characters(run, good, tmp_path):
    (path := tmp_path / "evil\x1b[2J.h5").write_bytes(good[:-1])
    result = run("inspect", path, "--json")
    assert (result.exit_code, result.stdout) == (7, "")
    assert "\x1b" not in result.stderr
    assert json.loads(result.stderr)["code"] == 7
