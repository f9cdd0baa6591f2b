"""Listing a store is quick because it loads nothing heavy."""

import subprocess
import sys

import pytest

from skillctl import store


def loaded(code: str) -> set[str]:
    code += "\nimport sys; print(*{name.split('.')[0] for name in sys.modules})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def test_naming_and_listing_skills_needs_neither_hdf5_nor_pydantic(tmp_path):
    (tmp_path / "reach").mkdir()
    (tmp_path / "reach" / "1.h5").touch()
    code = (
        "from pathlib import Path; from skillctl import store\n"
        f"r = store.Registry(Path({str(tmp_path)!r}))\n"
        "assert r.names() == ('reach',) and r.versions('reach') == (1,); r.resolve('reach')\n"
        "store.write_file, store.locate_store()"
    )
    assert not loaded(code) & {"h5py", "pydantic", "numpy", "scipy"}


def test_reading_a_skill_needs_no_scipy():
    modules = loaded("from skillctl import store; store.read_skill")
    assert "h5py" in modules
    assert not modules & {"scipy", "typer", "rich", "pybullet"}


def test_plugins_are_off_before_hdf5_starts():
    code = "from skillctl import store; store.read_skill; import os; print(os.environ['HDF5_PLUGIN_PRELOAD'])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "::\n"


def test_every_public_name_exists():
    for name in store.__all__:
        assert getattr(store, name).__module__.startswith("skillctl.store")
    assert len(set(store.__all__)) == len(store.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = store.nothing
