"""The command, the skill and the results of a sealed artifact must fit each other."""

import json

import pytest

from skillctl import store
from skillctl.errors import InvalidModelError


@pytest.fixture
def with_operation(with_meta, meta):
    """A sealed artifact of a combined skill of two parts, whose operation says something else."""

    def change(parents=2, **stated):
        provenance = {**meta["provenance"], "parents": (meta["provenance"]["parents"] * 3)[:parents]}
        operation = {**meta["operation"], **stated}
        return with_meta(
            json.dumps({**meta, "operation": operation, "provenance": provenance}).encode(), honest=True
        )

    return change


@pytest.mark.parametrize("command", ["learn", "merge", "chain"])
def test_the_command_makes_such_a_skill(refuse, with_operation, command):
    refuse(with_operation(command=command), f"operation.command: {command} makes no combined skill")


def test_a_skill_of_any_kind_comes_from_python(artifact):
    from dataclasses import replace

    saved = replace(artifact, operation=store.Operation(command="python"))
    assert store.decode(store.encode(saved)).operation.command == "python"


@pytest.mark.parametrize(
    ("results", "cause"),
    [
        ({}, "operation.results.kept: Field required"),
        ({"kept": 1.0}, "operation.results.kept: "),
        ({"kept": [1.0, -0.5]}, "operation.results.kept.1: "),
        ({"kept": [1.0, "half"]}, "operation.results.kept.1: "),
        ({"kept": [1.0], "lyapunov": "guessed"}, "operation.results.lyapunov: "),
        ({"kept": [1.0], "lyapunov": 1}, "operation.results.lyapunov: "),
    ],
)
def test_combine_records_what_parts_keep(refuse, with_operation, results, cause):
    refuse(with_operation(results=results), cause)


@pytest.mark.parametrize("parents", [0, 3])
def test_a_combined_skill_has_as_many_parents_as_can_be(refuse, with_operation, parents):
    refuse(with_operation(parents), f"provenance.parents: {parents} skills do not combine into 2 parts")


def test_combining_a_combined_skill_gives_more_parts_than_parents(with_operation):
    assert len(store.decode(with_operation(1)).provenance.parents) == 1


# What a file may not state is not written either; the sealing side is easier to reach for the other commands.


def stating(wrap, skill, **stated):
    from dataclasses import replace

    artifact = wrap(skill)
    operation = artifact.operation.model_copy(update=stated)
    return replace(artifact, operation=operation)


@pytest.mark.parametrize(
    "results", [{}, {"lyapunov": None}, {"lyapunov": "guessed"}, {"lyapunov": ("found",)}]
)
def test_merge_records_where_the_lyapunov_matrix_is_from(wrap, merged, results):
    with pytest.raises(
        InvalidModelError, match=r"cannot be stored: /meta\.json: operation\.results\.lyapunov"
    ):
        store.encode(stating(wrap, merged, results=results))


def test_merging_gives_one_part_a_parent(wrap, merged):
    from dataclasses import replace

    artifact = wrap(merged)
    provenance = artifact.provenance.model_copy(update={"parents": artifact.provenance.parents[:1]})
    with pytest.raises(InvalidModelError, match=r"parents: 1 skills do not merge into 2 parts"):
        store.encode(replace(artifact, provenance=provenance))


HELD_OUT: dict[str, object] = {
    "held_out_demonstrations": 3,
    "held_out_dtw": None,
    "held_out_worst_dtw": 0.5,
    "held_out_arrived": 2,
}


def test_learn_records_held_out_errors_as_a_whole_or_not_at_all(wrap, make_seds):
    angles: dict[str, object] = {"held_out_dtw_angle": 0.02, "held_out_worst_dtw_angle": 0.03}
    complete: list[dict[str, object]] = [
        {},
        HELD_OUT,
        {"objective": 0.5, **HELD_OUT},
        {**HELD_OUT, **angles},
    ]
    for results in complete:
        assert (
            store.decode(store.encode(stating(wrap, make_seds(1), results=results))).operation.results
            == results
        )
    wrong: list[dict[str, object]] = [
        {"held_out_dtw": 0.5},
        {**HELD_OUT, "held_out_x": 1},
        {**HELD_OUT, "held_out_dtw": "x"},
    ]
    for results in wrong:
        with pytest.raises(InvalidModelError, match=r"operation\.results\.held_out_"):
            store.encode(stating(wrap, make_seds(1), results=results))


def test_results_hold_codes_and_notes(wrap, make_seds):
    results = {"converged": False, "iterations": 40, "notes": ("the fit ran out of steps", "a second note")}
    read = store.decode(store.encode(stating(wrap, make_seds(1), results=results)))
    assert read.operation.results == results
