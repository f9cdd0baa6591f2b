"""How long does it take to list ten thousand versions? ``--benchmark-enable`` measures it."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillctl.usecases.ls import list_skills

ARCHIVE = Path(__file__).parents[1] / "archives" / "v1" / "seds.h5"
VERSIONS = 10_000


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    (skill := tmp_path_factory.mktemp("skills") / "reach").mkdir()
    data = ARCHIVE.read_bytes()
    for number in range(1, VERSIONS + 1):
        (skill / f"{number}.h5").write_bytes(data)
    return skill.parent


@pytest.mark.parametrize("check", [False, True], ids=["headers", "whole files"])
def test_listing_ten_thousand_versions(benchmark, many, check):
    report = benchmark(list_skills, many, check=check)
    assert len(report.skills[0].entries) == VERSIONS
    assert all(entry.problem is None for entry in report.skills[0].entries)
