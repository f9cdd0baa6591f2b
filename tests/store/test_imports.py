"""Listing a store is quick because it loads nothing heavy."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import skillctl
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
        "assert r.names() == ('reach',) and r.versions('reach') == (1,); r.locate('reach').path\n"
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


def calls(path: Path):
    """Yield (dotted name, arguments) of every call in a module."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), [ast.unparse(argument) for argument in node.args]


def test_one_place_opens_hdf5_to_read_skills():
    package = Path(skillctl.__file__).parent
    opened = {
        (str(path.relative_to(package)), name, *arguments[1:])
        for path in package.rglob("*.py")
        for name, arguments in calls(path)
        if re.fullmatch(r"h5py\.(File|h5f\.\w+)|h5f\.\w+", name)
    }
    by_name = re.compile(r"from h5py import .*\b(File|h5f)\b")
    assert not any(by_name.search(path.read_text(encoding="utf-8")) for path in package.rglob("*.py"))
    writers = ("store/writer.py", "simulation/recording.py", "drivers/log.py")
    written = {(path, "h5py.File", "'w'") for path in writers}
    assert opened - written == {
        ("store/reader.py", "h5py.File", "'r'"),
        ("demonstrations/hdf5.py", "h5py.File", "'r'"),  # other people's data, in a child of its own
    }


def test_only_one_module_of_the_store_imports_h5py_and_it_turns_plugins_off_first():
    folder = Path(store.__file__).parent
    importing = {
        path.name: path
        for path in folder.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if (isinstance(node, ast.Import) and any(alias.name.startswith("h5py") for alias in node.names))
        or (isinstance(node, ast.ImportFrom) and (node.module or "").startswith("h5py"))
    }
    assert set(importing) == {"hdf5.py"}
    text = importing["hdf5.py"].read_text(encoding="utf-8")
    assert text.index('os.environ["HDF5_PLUGIN_PRELOAD"] = "::"') < text.index("import h5py\n")


def test_every_public_name_exists():
    tree = ast.parse(Path(store.__file__).read_text(encoding="utf-8"))
    (declared,) = (node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in declared.body if isinstance(node, ast.ImportFrom)]
    assert imports == declared.body
    homes = {alias.name: node.module for node in imports for alias in node.names}
    assert homes == {name: f"skillctl.store.{module}" for name, module in store._HOMES.items()}
    for name, home in homes.items():
        assert getattr(store, name).__module__ == home
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = store.nothing
