"""A skill in C commands what its controller commands, whatever its kind and the compiler."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from skillctl.codegen import check as checking
from skillctl.codegen.check import check
from skillctl.codegen.header import Facts, digest_in, header_of, prefix_of
from skillctl.codegen.text import kept, named, quoted
from skillctl.errors import ArtifactError, NotFoundError
from skillctl.model.controller import Controller
from skillctl.model.limits import Limits
from skillctl.usecases.c99 import exported_c99

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
C, CPP = ("-std=c99", "-x", "c"), ("-std=c++17", "-x", "c++")
SANITIZED = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
OTHERS = (  # clang where it is installed
    ("sanitized C99", "SANITIZED", ("clang", "gcc"), (*C, *SANITIZED)),
    ("clang++", "CLANGXX", ("clang++",), CPP),
)


@pytest.fixture
def few(monkeypatch):
    """Compare at a thousand states instead of ten thousand."""
    monkeypatch.setattr(checking, "STATES", 1000)


@pytest.fixture
def compiled(tmp_path):
    """Return a function that compiles a program beside headers and returns what it prints."""

    def compile_and_run(program, *options, compiler="cc", **headers):
        for name, text in headers.items():
            (tmp_path / f"{name}.h").write_text(text)
        (tmp_path / "main.c").write_text(program)
        command = [compiler, *STRICT, *options, "main.c", "-o", "main", "-lm"]
        subprocess.run(command, cwd=tmp_path, check=True)
        return subprocess.run(["./main"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout

    return compile_and_run


def surroundings(**variables):
    return {"PATH": os.environ["PATH"], **variables}


def test_every_kind_commands_the_same_with_every_compiler_and_sanitizers_find_nothing(
    few, monkeypatch, skill_of, kind
):
    """A sanitizer's finding ends the program, which would be a problem."""
    monkeypatch.setattr(checking, "LANGUAGES", (*checking.LANGUAGES, *OTHERS))
    skill = skill_of(kind)
    found = check(skill, exported_c99(skill, kind), (), 0.01, {"PATH": os.environ["PATH"]})
    assert found.problem == ""
    assert found.difference <= 1e-12  # asked of the export; rounding alone is some 1e-14 here
    assert len(found.compilers) == 3 + bool(shutil.which("clang++"))


def test_ten_thousand_states_are_compared(skill_of):
    skill = skill_of("latched")
    found = check(skill, exported_c99(skill, "reach"), (), 0.01, surroundings())
    assert (found.problem, found.states) == ("", 10_000)


@pytest.mark.parametrize(
    ("kind", "pattern", "value"),
    [
        ("learned", r"(_table_1_\[[^=]*= \{\{-?)0x1\.", "0x1.00001"),  # a matrix, by one part in a million
        ("latched", r"(_DISTURBANCE )0x1\S+", "0x1p+9"),  # no push is noticed
        ("pose", r"(_SEAM_ )\S+", "0x1p+9"),  # no side is kept
        ("chain", r'(\{"wait 0.03", )0x[^}]+', "0x1p-20"),  # the stage goes on at once
        ("chain", r"(_ROUNDING_ )\S+", "0x1p+1"),  # two periods less are waited
        ("learned", r"(_FOLLOWING_ )\S+", "0x1p-2"),  # slower than the acceleration asks for
        ("learned", r"(#define \w+_AVERAGED )100", "9"),  # too few periods for the jerk
        ("pose", r"(_DESCENT_ )\S+", "0x1p+2"),  # brakes where it need not
        ("in shears", r"(_CLOSE_ )\S+", "0x1p-20"),  # a limit that is hardly kept
    ],
)
def test_a_header_that_differs_is_found_out(few, skill_of, kind, pattern, value):
    skill = skill_of(kind)
    header = exported_c99(skill, kind)
    changed = re.sub(pattern, rf"\g<1>{value}", header, count=1)
    assert changed != header
    assert check(skill, changed, (), 0.01, surroundings()).problem


def test_a_chain_that_stays_is_not_one_that_goes_back(few, skill_of):
    chain = skill_of("chain that goes back")
    header = exported_c99(replace(chain, on_jump="stay"), "reach")
    assert "remembers something else" in check(chain, header, (), 0.01, surroundings()).problem


def test_a_chain_in_c_does_one_thing_after_the_other(compiled, skill_of):
    """The motion, its events and their order are known from the chain itself."""
    chain = skill_of("chain")
    program = """
        #include <stdio.h>
        #include <string.h>
        #include "pick.h"
        int main(void)
        {
            double state[3] = {0.6, 0.3, 0.1}, command[3];
            const char *last = "";
            skill_controller c;
            int steps, i;
            skill_begin_unproved(&c, 0.01);
            if (skill_go(&c, 3) != SKILL_BAD_STAGE || skill_stage(&c) != -1) return 1;
            for (steps = 0; steps < 20000 && !c.done; ++steps) {
                if (skill_step(&c, state, command) != SKILL_OK) return 1;
                if (c.event != NULL && strcmp(c.event, last) != 0) {
                    printf("%d %s, ", skill_stage(&c), c.event);
                }
                last = c.event == NULL ? "" : c.event;
                for (i = 0; i < 3; ++i) state[i] = c.next[i];
            }
            printf("%d %d", skill_stage(&c), skill_remaining(state) < 0.05);
            return 0;
        }"""
    happened = [f"{stage} {event}" for stage, events in enumerate(chain.events) for event in events]
    assert compiled(program, pick=exported_c99(chain, "pick")) == ", ".join([*happened, "2 1"])


def test_a_header_that_does_not_compile_is_a_problem(few, skill_of):
    header = exported_c99(skill_of("learned"), "reach").replace("double slope", "float slope", 1)
    assert (
        "cc (C99)"
        in check(skill_of("learned"), f"{header}int unused(void)", (), 0.01, surroundings()).problem
    )


def test_without_a_compiler_there_is_no_check(few, skill_of, tmp_path):
    with pytest.raises(NotFoundError, match="no C compiler"):
        check(skill_of("learned"), "", (), 0.01, {"PATH": str(tmp_path)})
    with pytest.raises(NotFoundError, match="nowhere-cc"):
        check(skill_of("learned"), "", (), 0.01, surroundings(CC="nowhere-cc"))


def test_one_linear_component_commands_its_matrix_times_the_offset(compiled, make_skill):
    skill = make_skill(np.random.default_rng(0), n_components=1, attractor=[0.5, -0.25])
    program = """
        #include <stdio.h>
        #include "reach.h"
        int main(void)
        {
            const double state[2] = {1.0, 0.25};
            double command[2];
            skill_controller c;
            skill_begin_unproved(&c, 0.125);
            if (skill_step(&c, state, command) != SKILL_OK) return 1;
            printf("%.17g %.17g ", command[0], command[1]);
            printf("%.17g %.17g", c.next[0], c.next[1]);
            return 0;
        }"""
    values = np.array(compiled(program, reach=exported_c99(skill, "reach")).split(), dtype=float)
    expected = skill.system_matrices[0] @ [0.5, 0.5]
    np.testing.assert_allclose(
        values[:2], expected, rtol=0, atol=8 * np.finfo(float).eps * abs(expected).max()
    )
    np.testing.assert_array_equal(values[2:], np.array([1.0, 0.25]) + 0.125 * values[:2])


def test_what_cannot_be_followed_is_refused_and_nothing_moves(compiled, skill_of):
    program = """
        #include <assert.h>
        #include "grasp.h"
        int main(void)
        {
            double state[6] = {0.4, -0.1, 0.3, 0.0, 2.0, -1.0};
            double command[6] = {1.0, 1.0, 1.0, 1.0, 1.0, 1.0};
            const double nowhere[4] = {0.0}, quaternion[4] = {0.0, 0.0, -3.0, -3.0};
            skill_controller c;
            int part;
            assert(skill_begin(&c, 2.0 * SKILL_PERIOD_MAX) == SKILL_BAD_PERIOD);
            assert(skill_step(&c, state, command) == SKILL_BAD_PERIOD);
            assert(command[0] == 0.0 && command[5] == 0.0);
            assert(skill_begin_unproved(&c, -1.0) == SKILL_BAD_PERIOD);
            assert(skill_begin_unproved(&c, HUGE_VAL) == SKILL_BAD_PERIOD);
            assert(skill_begin(&c, SKILL_PERIOD_MAX) == SKILL_OK);
            assert(skill_step(&c, state, command) == SKILL_OK);
            part = c.part;
            state[4] = HUGE_VAL - HUGE_VAL;
            command[2] = 1.0;
            assert(skill_step(&c, state, command) == SKILL_BAD_STATE);
            assert(command[2] == 0.0 && c.part == part);
            state[4] = 2.0;
            c.max_turn = 0.0;
            assert(skill_step(&c, state, command) == SKILL_BAD_LIMIT);
            assert(skill_state_of_pose(state, nowhere, command) == SKILL_BAD_STATE);
            assert(skill_state_of_pose(state, quaternion, command) == SKILL_OK);
            assert(fabs(command[5] - 1.5707963267948966) < 1e-15 && command[0] == state[0]);
            assert(skill_remaining(skill_targets[0]) < 1e-15);
            assert(fabs(skill_distance(state, skill_targets[0]) - skill_remaining(state)) < 1e-15);
            return 0;
        }"""
    compiled(program, grasp=exported_c99(skill_of("pose"), "grasp"))


def test_a_controller_brakes_to_rest_within_its_limits(compiled, skill_of):
    """As it does in Python: ten steps, and then to rest."""
    program = """
        #include <stdio.h>
        #include "reach.h"
        int main(void)
        {
            double state[3] = {0.8, -0.3, 0.4}, command[3];
            skill_controller c;
            int steps = 0, i;
            skill_begin_unproved(&c, 0.01);
            c.max_jerk = 40.0;
            if (skill_step(&c, state, command) != SKILL_BAD_LIMIT) return 1;
            c.max_acceleration = 2.0;
            do {
                if (++steps <= 10) skill_step(&c, state, command);
                else skill_brake(&c, command);
                printf("%.17g %.17g %.17g\\n", command[0], command[1], command[2]);
                for (i = 0; i < 3; ++i) state[i] = c.next[i];
            } while (!skill_resting(&c));
            return 0;
        }"""
    skill, period = skill_of("learned"), 0.01
    rows = compiled(program, reach=exported_c99(skill, "reach")).split("\n")[:-1]
    commands = np.array([row.split() for row in rows], dtype=float)
    limits = Limits(acceleration=2.0, jerk=40.0)
    controller = Controller(skill, period, limits=limits, allow_unproved=True)
    state = np.array([0.8, -0.3, 0.4])
    expected: list[np.ndarray] = []
    while not (expected and controller.resting):
        expected.append(controller.step(state) if len(expected) < 10 else controller.brake())
        state = controller.next
    # Forty steps, each of which rounds what it adds to the state by a last bit.
    np.testing.assert_allclose(commands, expected, rtol=1e-12, atol=1e-14)
    changes = np.diff(np.vstack([np.zeros(3), commands]), axis=0) / period
    assert np.linalg.norm(changes, axis=1).max() <= 2.0 * (1 + 1e-9)
    assert np.linalg.norm(np.diff(changes, axis=0), axis=1).max() / period <= 40.0 * (1 + 1e-9)


def test_two_skills_live_in_one_program_under_their_own_names(compiled, skill_of):
    program = """
        #include <stdio.h>
        #include "reach.h"
        #include "grasp.h"
        #include "reach.h"
        #if defined(skill_step) || defined(SKILL_PERIOD_MAX)
        #error "Which skill is meant?"
        #endif
        int main(void)
        {
            reach_controller one;
            grasp_controller other;
            double command[6];
            reach_begin_unproved(&one, 0.01);
            grasp_begin_unproved(&other, 0.01);
            reach_step(&one, reach_targets[0], command);
            grasp_step(&other, grasp_targets[0], command);
            printf("%d %d %s %s", REACH_DIMENSION, GRASP_DIMENSION, REACH_NAME, GRASP_NAME);
            return 0;
        }"""
    headers = {
        name: exported_c99(skill_of(kind), name) for name, kind in (("reach", "learned"), ("grasp", "pose"))
    }
    assert compiled(program, **headers) == "3 6 reach grasp"


def test_a_header_tests_itself(compiled, skill_of, kind):
    header = exported_c99(skill_of(kind), "reach")
    program = '#include "reach.h"\n'
    assert (
        compiled(program, "-DSKILL_SELFTEST", reach=header) == "100 of 100 commands are those of the skill\n"
    )
    tests = header.index("_tests_[] = {")
    changed = header[:tests] + re.sub(r"\{0x1\.", "{0x1.8", header[tests:], count=1)
    with pytest.raises(subprocess.CalledProcessError):
        compiled(program, "-DSKILL_SELFTEST", reach=changed)


def test_a_controller_that_forgets_begins_anew(compiled, skill_of):
    """Where each part begins is known from Python; after a reset the same state is a start."""
    skill = skill_of("latched")
    starts = [part.attractor for part in skill.parts[:2]]
    parts = [int(skill.selected(start)) for start in starts]
    assert parts[0] != parts[1]
    rows = ", ".join(f"{{{', '.join(float(x).hex() for x in start)}}}" for start in starts)
    program = f"""
        #include <stdio.h>
        #include "reach.h"
        int main(void)
        {{
            const double starts[2][3] = {{{rows}}};
            double command[3];
            skill_controller c;
            skill_begin_unproved(&c, 0.01);
            skill_step(&c, starts[0], command);
            printf("%d ", c.part);
            skill_step(&c, c.next, command);
            printf("%d ", c.part);
            skill_step(&c, starts[1], command);
            printf("%d ", c.part);
            skill_reset(&c);
            skill_step(&c, starts[0], command);
            printf("%d", c.part);
            return 0;
        }}"""
    controller = Controller(skill, 0.01, allow_unproved=True)
    controller.step(starts[0])
    controller.step(controller.next)
    kept_part = controller.part
    printed = compiled(program, reach=exported_c99(skill, "reach")).split()
    assert printed == [str(part) for part in (parts[0], kept_part, parts[1], parts[0])]


def test_fast_mathematics_is_refused(compiled, skill_of):
    program = '#include "reach.h"\nint main(void) { return 0; }\n'
    header = exported_c99(skill_of("learned"), "reach")
    compiled(program, reach=header)
    with pytest.raises(subprocess.CalledProcessError):
        compiled(program, "-ffast-math", reach=header)


def test_the_same_skill_gives_the_same_header(skill_of):
    assert exported_c99(skill_of("nested"), "reach") == exported_c99(skill_of("nested"), "reach")


@pytest.mark.parametrize("text", ['a "b" \\ ??/ \n %d', "ξ*/é", ""])
def test_texts_are_what_they_were(compiled, text):
    program = f"#include <stdio.h>\nint main(void) {{ fputs({quoted(text)}, stdout); return 0; }}\n"
    assert compiled(program) == text


def test_names_in_c_begin_with_that_of_the_skill():
    assert [prefix_of(name) for name in ("top-left", "Shelf 2!", "reach")] == ["top_left", "shelf_2", "reach"]
    assert [prefix_of(name) for name in ("7up", "skill", "ξ")] == ["my_7up", "my_skill", "my_skill"]
    assert named("skill_step SKILL_OK SKILL_SELFTEST", "reach") == "reach_step REACH_OK SKILL_SELFTEST"
    assert named("my_skill_step", "reach") == "my_skill_step"


def test_a_template_keeps_what_is_needed():
    template = "a\n#if ONE\nb\n#if !TWO\nc\n#else\nd\n#endif\n#else\ne\n#endif\n#endif /* C's own */\n"
    assert kept(template, {"ONE": True, "TWO": True}) == "a\nb\nd\n#endif /* C's own */\n"
    assert kept(template, {"ONE": True, "TWO": False}) == "a\nb\nc\n#endif /* C's own */\n"
    assert kept(template, {"ONE": False, "TWO": False}) == "a\ne\n#endif /* C's own */\n"


def test_a_header_says_what_it_was_made_of_and_whether_it_was_changed(skill_of):
    digest = f"sha256:{'0123456789abcdef' * 4}"
    facts = Facts("reach", digest, "stable", "global", "", 0.5, 0.02)
    header = header_of(skill_of("learned"), facts, ())
    assert digest_in(header, "reach.h") == digest
    assert digest_in(exported_c99(skill_of("learned"), "reach"), "reach.h") == ""
    for changed in (
        header.replace("0x1.", "0x1.1", 1),
        header[:-1],
        f"{header}\n",
        header.replace("012", "013", 1),
    ):
        with pytest.raises(ArtifactError):
            digest_in(changed, "reach.h")
    with pytest.raises(ArtifactError, match="not a header"):
        digest_in("#include <math.h>\n", "math.h")
