"""Files that are sealed again with numbers that form no skill."""

import numpy as np
import pytest

from skillctl import store

MEANS = "model/means"


def changed(path, index, value):
    def edit(body):
        body[path][index] = value

    return edit


NUMBERS = [
    "model/priors", "model/means", "model/covariances", "model/system_matrices", "model/residual_covariances",
    "model/attractors", "model/lyapunov", "model/density_priors", "model/density_means",
    "model/density_covariances", "demonstrations/positions", "demonstrations/times",
    "golden/times", "golden/states",
]  # fmt: skip


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("path", NUMBERS)
def test_numbers_must_be_finite(refuse, hostile, path, value):
    def edit(body):
        body[path][(0,) * body[path].ndim] = value

    refuse(hostile(edit), f"/{path}: must be finite")


def shifted_prior(body):
    body["model/priors"][0] += 1e-6


def negative_prior(body):
    priors = body["model/priors"]
    priors[1] += 2 * priors[0]
    priors[0] = -priors[0]


def asymmetric(path):
    def edit(body):
        body[path][0, 0, 1] = np.nextafter(body[path][0, 0, 1], 9)

    return edit


def indefinite(path):
    def edit(body):
        body[path][0] = np.array([[1.0, 2.0], [2.0, 1.0]])

    return edit


def scaled_by(factor):
    def edit(body):
        body["model/covariances"][0] *= factor

    return edit


@pytest.mark.parametrize(("edit", "cause"), [
    (shifted_prior, "leaf 0: priors: must be positive and sum to one"),
    (negative_prior, "leaf 0: priors: must be positive and sum to one"),
    *[(asymmetric(f"model/{name}"), "must be symmetric") for name in
      ("covariances", "residual_covariances", "lyapunov", "density_covariances")],
    *[(indefinite(f"model/{name}"), "must be positive definite") for name in
      ("covariances", "residual_covariances", "lyapunov", "density_covariances")],
    (changed("model/attractors", (0, 0), 7.0), "must share one attractor"),
    (changed("model/lyapunov", (1, 0, 0), 7.0), "must share .* one Lyapunov matrix"),
    *[(scaled_by(factor), "leaf 0: means and covariances: too large or too small") for factor in
      (1e-311, 1e-300, 1e-120)],
    (changed("model/density_means", (0, 0), 1e300), "leaf 0: means and covariances: too large or too small"),
    (changed("demonstrations/times", 1, -1.0), "time does not increase"),
    (changed("demonstrations/offsets", 0, 1), "must rise from 0"),
    (changed("demonstrations/offsets", 1, 2**62), "must rise from 0"),
    (changed("demonstrations/offsets", 1, -(2**63)), "must rise from 0"),
    (changed("demonstrations/offsets", 1, 1), "one point only"),
    (changed("demonstrations/offsets", -1, 3), "must rise from 0"),
    (changed("demonstrations/part", 0, -1), "must be leaf numbers below 4, in order"),
    (changed("demonstrations/part", -1, 4), "must be leaf numbers below 4, in order"),
    (changed("demonstrations/part", 0, 3), "must be leaf numbers below 4, in order"),
])  # fmt: skip
def test_numbers_must_form_a_skill(refuse, hostile, edit, cause, recwarn):
    refuse(hostile(edit), cause)
    assert not recwarn.list


def test_an_unstable_skill_is_read(hostile):
    """Whether a skill is stable is for the proof to say, not for the reader."""

    def edit(body):
        body["model/system_matrices"][0] = np.zeros((2, 2))
        body["model/system_matrices"][1] = np.eye(2)
        body["model/system_matrices"][2] = np.array([[-1.0, 1e-100], [-1e-100, 0.0]])

    read = store.decode(hostile(edit, honest=True))
    assert (read.skill.leaves[0].system_matrices[1] == np.eye(2)).all()


def test_weights_may_miss_one_by_rounding_only(refuse, hostile):
    def shifted(ulps):
        def edit(body):
            priors = body["model/priors"][()]
            priors[0] += 1 - priors[:3].sum() + ulps * 2.0**-52  # the leaf's three
            body["model/priors"][...] = priors

        return edit

    store.decode(hostile(shifted(20), honest=True))
    refuse(hostile(shifted(30)), "leaf 0: priors: must be positive and sum to one")  # 8 n = 24


def test_a_demonstration_that_never_moves(refuse, hostile):
    def edit(body):
        rows = slice(*body["demonstrations/offsets"][:2])
        body["demonstrations/positions"][rows] = 0.5

    refuse(hostile(edit), "motion-0.csv#0")
