"""Who may import whom, and what an extension touches: read from the source, functions and all."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import skillctl
from skillctl.cli.schema import OUTPUTS, schema_of_output

PACKAGE = Path(skillctl.__file__).parent
ROOT = PACKAGE.parent
LEAVES = {"errors", "memory", "arrays", "progress", "geometry", "rotations", "opening", "exact", "options"}
TOOLS = {"workers", "toml_files"}  # how work is done and files are read, whatever they are about
SIBLINGS = {
    "learning",
    "compose",
    "stability",
    "codegen",
    "metrics",
    "demonstrations",
    "store",
    "simulation",
    "plotting",
}
FLOORS = ("evaluate", "adapt", "drivers")  # above the siblings; each may know those before it
MODULES = sorted(PACKAGE.rglob("*.py"))
LINE_LIMIT = 420  # a module that needs more is two modules

# What is often added, and a name that one that is there already has in the code. Whatever module says that
# name would have to say the next one's, too: the table in CONTRIBUTING.md counts them.
EXAMPLES = {
    "a demonstration format": "tum",
    "a merge gate": "experts",
    "an arm": "xarm6",
    "an exit code": "FIT_FAILED",
    "a state space": "Euclidean",
    "a store backend": "LocalBackend",
    "an array in the artifact": "density_covariances",
    "an export": "_npz",
    "a task clause": "Approach",
}

# Third-party packages that only some rooms may know.
ONLY_IN = {
    "cryptography": {"store"},
    "pybullet": {"simulation"},
    "pybullet_data": {"simulation"},
    "h5py": {"store", "demonstrations", "simulation", "drivers"},
    "pydantic": {"store", "simulation", "adapt", "usecases", "cli"},
    "typer": {"cli"},
    "rich": {"cli"},
    "PIL": {"simulation", "plotting"},
    "matplotlib": {"plotting"},
    "av": {"simulation"},
    "distributed": {"workers"},
    "rosbags": {"demonstrations"},
    "pyarrow": {"demonstrations"},
    "click": set(),
}


def room_of(path: Path) -> str:
    """Return the room a module belongs to: its folder, or its own name at the top level."""
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


def imports_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, dotted name) for every import in a module, whatever its nesting."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            yield node.lineno, node.module or ""
            if node.module == "skillctl":
                yield from ((node.lineno, f"skillctl.{alias.name}") for alias in node.names)


def allowed_rooms(room: str) -> set[str]:
    """Return the rooms that a room may import besides itself."""
    if room in LEAVES:
        return LEAVES
    if room == "model":
        return LEAVES
    if room in TOOLS:
        return LEAVES
    if room in SIBLINGS:
        return LEAVES | TOOLS | {"model"}
    below = LEAVES | TOOLS | {"model"} | SIBLINGS
    if room in FLOORS:
        return below | set(FLOORS[: FLOORS.index(room)])
    if room == "usecases":
        return below | set(FLOORS)
    return below | {*FLOORS, "usecases", "cli"}  # cli, __init__, __main__


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_dependencies_point_one_way(path: Path) -> None:
    room = room_of(path)
    for line, name in imports_of(path):
        parts = name.split(".")
        if parts[0] != "skillctl" or len(parts) == 1 or parts[1] in {room, "__version__"}:
            continue
        assert parts[1] in allowed_rooms(room), f"{path}:{line}: {room} must not import {name}"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_heavy_packages_stay_in_their_rooms(path: Path) -> None:
    room = room_of(path)
    for line, name in imports_of(path):
        rooms = ONLY_IN.get(name.split(".")[0])
        assert rooms is None or room in rooms, f"{path}:{line}: {room} must not import {name}"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_modules_stay_readable_in_one_sitting(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LINE_LIMIT


def test_model_needs_numpy_only() -> None:
    standard = {
        "__future__",
        "collections",
        "copy",
        "dataclasses",
        "typing",
        "skillctl",
        "numpy",
        "math",
        "re",
        "itertools",
        "abc",
        "functools",
        "types",
    }
    for path in (PACKAGE / "model").glob("*.py"):
        for line, name in imports_of(path):
            assert name.split(".")[0] in standard, f"{path}:{line}: {name}"


def test_every_report_has_a_published_schema() -> None:
    classes = [
        node
        for room in ("usecases", "cli")
        for path in (PACKAGE / room).glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef) and node.name.endswith("Report")
    ]
    extended = {ast.unparse(base) for node in classes for base in node.bases}  # printed as what extends them
    named = {node.name for node in classes} - extended
    published = {name for output in OUTPUTS for name in schema_of_output(output)["$defs"]}
    assert named <= published, f"add {', '.join(sorted(named - published))} to cli/schema.py"


def words_of(path: Path) -> set[str]:
    """Return the names in a module's code, and the words in its strings but for docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    prose = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    words = {path.stem}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in prose:
            words.update(re.findall(r"\w+", node.value))
        for field in ("id", "attr", "name", "arg", "module"):
            words.update((getattr(node, field, None) or "").split("."))
    return words


def measured() -> str:
    """Return the table of CONTRIBUTING.md: what names one of a kind, in lines of Markdown."""
    words = {str(path.relative_to(PACKAGE)): words_of(path) for path in MODULES}
    rows = ["| to add | there is | named in |", "| --- | --- | --- |"]
    for change, example in EXAMPLES.items():
        if places := [place for place, known in words.items() if example in known]:
            rows.append(f"| {change} | `{example}` | {len(places)}: {', '.join(places)} |")
    return "\n".join(rows) + "\n"


def test_contributing_says_what_an_extension_touches() -> None:
    table = measured()
    print(f"\n{table}")  # pytest -s
    written = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert table in written, f"put this into CONTRIBUTING.md:\n\n{table}"


def test_top_level_holds_what_the_architecture_names() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: nothing says which files belong")
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    names = {line.split("/")[0] for line in tracked.splitlines()}
    visible = {name for name in names if not name.startswith(".")}
    assert visible == {
        "pyproject.toml",
        "README.md",
        "LICENSE",
        "CHANGELOG.md",
        "CITATION.cff",
        "CONTRIBUTING.md",
        "SECURITY.md",
        "skillctl",
        "skills",
        "tests",
    }
