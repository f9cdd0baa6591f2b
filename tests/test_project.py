"""What the files around the code say of the project agrees with the code, and with each other."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from packaging.version import Version

import skillctl
from skillctl.toml_files import parse_toml

ROOT = Path(__file__).parent.parent


def test_the_citation_names_the_newest_release_of_the_changelog() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    first, second, *_ = re.findall(r"^## (.*)$", changelog, re.MULTILINE)
    assert first == "Unreleased"
    assert second == f"{citation['version']} - {citation['date-released']}"
    # Between two releases the version is that of the next one, marked as not released.
    released = Version(citation["version"])
    assert Version(skillctl.__version__) == released or (
        Version(skillctl.__version__) > released and Version(skillctl.__version__).is_devrelease
    )
    assert citation["license"] == "MIT"


def test_contributors_hooks_and_forms_are_valid() -> None:
    pytest.importorskip("pre_commit")
    command = [sys.executable, "-m", "pre_commit", "validate-config", str(ROOT / ".pre-commit-config.yaml")]
    assert subprocess.run(command, check=False).returncode == 0
    for form in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("[!c]*.yml"):
        document = yaml.safe_load(form.read_text(encoding="utf-8"))
        assert {"name", "description", "body"} <= set(document)
        assert all({"type", "attributes"} <= set(field) for field in document["body"])


def test_nobody_is_sent_to_the_package_index_for_skillctl() -> None:
    # Another project has that name there; this one is distributed as robot-skillctl.
    metadata = parse_toml((ROOT / "pyproject.toml").read_bytes())["project"]
    assert metadata["name"] == "robot-skillctl"
    assert metadata["scripts"] == {"skillctl": "skillctl.__main__:main"}
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: nothing says which files belong")
    pattern = r"pip install( -[-a-z]+)* '?skillctl"
    command = ["git", "grep", "-nE", pattern, "--", ".", ":!tests/test_project.py"]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout) == (1, "")
