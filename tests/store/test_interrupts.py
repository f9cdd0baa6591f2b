"""Ctrl-C, SIGTERM and a disk that refuses: whoever publishes is told what became of it."""

import os
import shutil
import signal
import subprocess
import sys

import pytest

from skillctl import store
from skillctl.cli.errors import describe
from skillctl.errors import Terminated
from skillctl.store import registry


@pytest.mark.parametrize("stop", [KeyboardInterrupt, Terminated])
@pytest.mark.parametrize(
    ("step", "after", "told"),
    [
        ("write", False, "nothing was published as reach"),
        ("fchmod", False, "nothing was published as reach"),
        ("link", False, "nothing was published as reach"),
        ("link", True, "reach@2 was published"),
        ("close", True, "reach@2 was published"),
    ],
)
def test_an_interrupt_says_whether_the_version_was_published(
    tmp_path, versions, monkeypatch, step, after, told, stop
):
    there = store.Registry(tmp_path)
    there.publish("reach", versions[0])
    real, real_link = getattr(os, step), os.link
    linked: list[object] = []

    def interrupted(*arguments, **options):
        if step == "close" and not linked:  # only the one that follows the link
            return real(*arguments, **options)
        if after:
            real(*arguments, **options)
        monkeypatch.undo()
        raise stop

    def link(*arguments, **options):
        real_link(*arguments, **options)
        linked.append(arguments)

    if step == "close":
        monkeypatch.setattr(os, "link", link)
    monkeypatch.setattr(os, step, interrupted)
    with pytest.raises(stop) as caught:
        there.publish("reach", versions[1])
    assert str(caught.value) == told
    numbers = (1, 2) if "was published" in told and "nothing" not in told else (1,)
    assert there.versions("reach") == numbers
    assert len(list((tmp_path / "reach").iterdir())) == len(numbers)  # nothing half, nothing left


SIGNALLED = """
import os, signal, sys
step, after, number = sys.argv[1], sys.argv[2] == "after", int(sys.argv[3])
real = getattr(os, step)
def signalled(*arguments, **options):
    if after: real(*arguments, **options)
    setattr(os, step, real)
    os.kill(os.getpid(), number)
    if not after: real(*arguments, **options)
setattr(os, step, signalled)
sys.argv = ["skillctl", "combine", sys.argv[4], sys.argv[5], "--name", "both", "--store", sys.argv[6]]
from skillctl.__main__ import main
main()
"""


def test_a_command_that_is_interrupted_after_it_has_published_says_so(tmp_path, versions, monkeypatch):
    monkeypatch.setattr(registry, "PUBLISHED", [])
    assert describe(KeyboardInterrupt()).message == "interrupted."
    there = store.Registry(tmp_path)
    there.publish("reach", versions[0])
    there.publish("reach", versions[0])  # the same again is no new version
    assert describe(KeyboardInterrupt()).message == "interrupted: reach@1 was published."
    there.publish("reach", versions[1])
    assert describe(Terminated()).message == "terminated: reach@1, reach@2 were published."


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
@pytest.mark.parametrize(
    ("moment", "told"), [("before", "nothing was published as both"), ("after", "both@1 was published")]
)
def test_a_signal_while_publishing_is_answered_on_standard_error(library, tmp_path, name, code, moment, told):
    parents = [library / parent / "1.h5" for parent in ("curve", "hook")]
    command = [
        sys.executable,
        "-c",
        SIGNALLED,
        "link",
        moment,
        int(getattr(signal, name)),
        *parents,
        tmp_path / "s",
    ]
    result = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, timeout=60)
    assert (result.returncode, result.stdout) == (code, "")
    word = {130: "interrupted", 143: "terminated"}[code]
    assert result.stderr == f"error: {word}: {told}.\n"
    assert store.Registry(tmp_path / "s").versions("both") == ((1,) if moment == "after" else ())


# Disks that refuse: real ones, mounted in a namespace of their own.

PUBLISH = """
import os, sys
from pathlib import Path
from skillctl import store
from skillctl.errors import StoreError
registry = store.Registry(Path(sys.argv[1]) / "skills")
first, second = (Path(name).read_bytes() for name in sys.argv[2:4])
registry.publish("reach", first)
os.system(sys.argv[4])
try:
    registry.publish("reach", second)
except StoreError as error:
    print(error, "|", error.hint)
left = sorted(path.name for path in (registry.root / "reach").iterdir())
print(left, store.read_skill(registry.locate("reach").path).digest == store.digest_of(first))
"""


def mounted(tmp_path, options, then, *files):
    """Publish on a small file system, which `then` makes refuse; return what is said and what is left."""
    (place := tmp_path / "disk").mkdir()
    publish = [sys.executable, "-c", PUBLISH, place, *files, then.format(place=place)]
    script = 'mount -t tmpfs -o "$0" tmpfs "$1" && shift && exec "$@"'
    command = ["unshare", "-rm", "sh", "-c", script, options, place, *publish]
    result = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, timeout=60)
    if shutil.which("unshare") is None or "permitted" in result.stderr or "denied" in result.stderr:
        pytest.skip("file systems cannot be mounted here")
    assert (result.returncode, result.stderr) == (0, "")
    return result.stdout.splitlines()


@pytest.mark.skipif(shutil.which("unshare") is None, reason="unshare is not installed")
@pytest.mark.parametrize(
    ("options", "then", "cause"),
    [
        ("size=1m", "dd if=/dev/zero of={place}/fill bs=4k status=none 2>/dev/null", "No space left"),
        ("size=1m,nr_inodes=6", "touch {place}/a {place}/b {place}/c 2>/dev/null", "No space left"),
        ("size=1m", "mount -o remount,ro {place}", "Read-only file system"),
    ],
    ids=["full", "no inodes", "read-only"],
)
def test_on_a_disk_that_refuses_old_versions_stay_whole_and_nothing_is_left(
    tmp_path, versions, options, then, cause
):
    files = []
    for index, data in enumerate(versions[:2]):
        (path := tmp_path / f"{index}.h5").write_bytes(data)
        files.append(path)
    said, left = mounted(tmp_path, options, then, *files)
    assert "cannot publish reach in " in said
    assert cause in said
    assert left == "['1.h5'] True"


def test_an_interrupt_inside_of_h5py_says_nothing_about_the_file(versions, monkeypatch):
    """Its compiled code turns some into a SystemError, which is how HDF5 answers damage, too."""

    def interrupted(*_, **__):
        raise SystemError("returned a result with an exception set") from Terminated()

    monkeypatch.setattr("h5py.File", interrupted)
    with pytest.raises(Terminated):
        store.digest_of(versions[0])
