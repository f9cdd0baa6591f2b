"""What is not a file is refused at once, wherever a user may name it."""

import ast
import os
import select
from collections.abc import Iterator
from pathlib import Path

import pytest

from skillctl import opening, store
from skillctl.demonstrations.files import read_bytes, sha256_of
from skillctl.errors import InputDataError, SkillctlError
from skillctl.opening import open_regular, read_from_pipe_or_file
from skillctl.simulation.meshes import find_mesh
from skillctl.simulation.robot_file import read_robot
from skillctl.simulation.scenario_file import read_scenario
from skillctl.store.lockfile import read_lock
from skillctl.usecases.manifest import read_manifest

ROOT = Path(__file__).parents[1] / "skillctl"

# Who opens files by other means, and why it may.
OTHERWISE = {
    "__main__.py": "standard streams",
    "cli/completion.py": "a file of ours; a shell's file, to append to it",
    "cli/output.py": "standard streams",
    "cli/page.py": "a file of ours",
    "codegen/check.py": "a file of ours",
    "codegen/header.py": "a file of ours",
    "demonstrations/archive.py": "bytes in memory",
    "demonstrations/hdf5.py": "in a child with a limit of time, after its beginning was read",
    "demonstrations/lerobot.py": "in a child with a limit of time",
    "demonstrations/matlab.py": "bytes in memory",
    "demonstrations/reader.py": "in a child with a limit of time, after its beginning was read",
    "demonstrations/bags.py": "in a child with a limit of time, after its beginning was read",
    "drivers/log.py": "to write; a log, after is_file",
    "drivers/registry.py": "an entry point",
    "memory.py": "files of the kernel",
    "plotting/style.py": "a file of ours",
    "simulation/arm.py": "a description of ours, whose meshes were opened",
    "simulation/bullet.py": "standard streams",
    "simulation/handling.py": "a gripper",
    "simulation/probe.py": "in a child with a limit of time",
    "simulation/recording.py": "to write",
    "simulation/video.py": "to write",
    "store/files.py": "without following links; asks is_regular",
    "store/local.py": "directories, and to write",
    "store/policy.py": "bytes in memory",
    "store/reader.py": "bytes in memory",
    "store/writer.py": "bytes in memory",
    "workers/serving.py": "standard streams",
    "opening.py": "here",
}
OPENERS = {
    "open", "read_text", "read_bytes", "fromfile", "genfromtxt", "File", "load", "loadmat", "loadURDF",
    "ParquetFile",
}  # fmt: skip


@pytest.fixture
def pipes(tmp_path: Path) -> Path:
    for suffix in ("urdf", "stl", "mtl", "png"):
        os.mkfifo(tmp_path / f"pipe.{suffix}")
    return tmp_path


@pytest.mark.parametrize(
    "read",
    [
        open_regular, read_scenario, read_manifest, read_robot, read_bytes, sha256_of, read_lock,
        store.read_skill,
    ],
)  # fmt: skip
@pytest.mark.parametrize("what", ["pipe.urdf", "/dev/zero", "/proc/kmsg"])
def test_a_pipe_or_a_device_is_not_waited_for(pipes: Path, read, what: str) -> None:
    if what == "/proc/kmsg":
        require_waiting(Path(what))
    with pytest.raises(SkillctlError, match="not a regular file"):
        read(pipes / what)


@pytest.mark.parametrize("read", [open_regular, read_scenario, read_manifest, read_robot])
def test_a_directory_is_no_file(tmp_path: Path, read) -> None:
    with pytest.raises(InputDataError, match="is not a regular file"):
        read(tmp_path)


def require_waiting(path: Path) -> None:
    """Skip unless the file says that it is regular, and has nothing to read now."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError:
        pytest.skip("it may not be opened")
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    ready = poll.poll(0)
    os.close(descriptor)
    if ready:
        pytest.skip("the kernel has messages, which reading would take away")


def test_a_mesh_that_is_a_pipe_or_names_one_is_refused(pipes: Path) -> None:
    (pipes / "by-library.obj").write_text("mtllib pipe.mtl\nv 0 0 0\n")
    (pipes / "by-texture.obj").write_text("v 0 0 0\n  mtllib library.mtl\n")
    (pipes / "library.mtl").write_text("newmtl red\nmap_Kd pipe.png\nmap_Ks missing.png\n")
    (pipes / "plain.obj").write_text("mtllib missing.mtl\nmtllib\nv 0 0 0\n")
    for name, culprit in (
        ("pipe.stl", "'pipe.stl'"),
        ("by-library.obj", "pipe.mtl"),
        ("by-texture.obj", "pipe.png"),
    ):
        with pytest.raises(InputDataError, match=rf"{culprit}.*which is not a regular file"):
            find_mesh(name, pipes)
    assert find_mesh("plain.obj", pipes) == (pipes / "plain.obj").resolve()


def test_what_comes_out_of_a_pipe_is_waited_for_but_not_for_ever(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(opening, "PATIENCE", 0.2)
    os.mkfifo(pipe := tmp_path / "key.pem")
    with pytest.raises(InputDataError, match=r"nothing came out of it in 0\.2 s"):
        read_from_pipe_or_file(pipe, 100)
    writer = os.open(pipe, os.O_RDWR)
    os.write(writer, b"key")
    with pytest.raises(InputDataError, match="nothing came out"):  # it might still go on
        read_from_pipe_or_file(pipe, 100)
    os.write(writer, b"0123")
    assert read_from_pipe_or_file(pipe, 4) == b"0123"
    os.close(writer)
    (plain := tmp_path / "plain").write_bytes(b"key")
    assert read_from_pipe_or_file(plain, 100) == b"key"


def openings() -> Iterator[str]:
    for path in sorted(ROOT.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                name = getattr(node.func, "attr", None) or getattr(node.func, "id", None)
                if name in OPENERS:
                    yield path.relative_to(ROOT).as_posix()


def test_every_other_opening_of_a_file_is_known() -> None:
    assert {*openings()} == OTHERWISE.keys()
