"""Matrices on the border of definiteness, in files: python tests/torture/definite.py --count 2000 --seed 0

P and the covariances of an archived skill are replaced by matrices that are a little more or less than
clearly definite, at every scale that a file may hold, or just beyond it. The reader has to accept exactly
those that are so by Sylvester's criterion in fractions, which shares no code with it, and P only if its
entries are moderate, too. Covariances of extreme scales may also be refused as such. The exit code is 1 if
it did otherwise.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from fractions import Fraction
from io import BytesIO
from itertools import permutations
from pathlib import Path
from random import Random

sys.path.insert(0, str(Path(__file__).parent))

import h5py
import numpy as np
from judging import SEAL, sealed_again, stated

from skillctl import store
from skillctl.errors import ArtifactError

ARCHIVE = Path(__file__).parents[1] / "archives" / "v2"
SPECIMENS = ("seds.h5", "seds-pose.h5", "seds-bent.h5")
PLACES = ("lyapunov", "covariances", "density_covariances", "residual_covariances")
CLEARLY = Fraction(1, 2**46)  # FORMAT.md: M − 2⁻⁴⁶ diag(M) ≻ 0
SMALLEST, LARGEST = (
    Fraction(10) ** -100,
    Fraction(10) ** 100,
)  # FORMAT.md, but for the rounding of these to float64


def determinant(rows: list[list[Fraction]]) -> Fraction:
    """Leibniz' sum over permutations: nothing is divided, and nothing is like elimination."""
    total = Fraction(0)
    for order in permutations(range(len(rows))):
        swaps = sum(order[i] > order[j] for i in range(len(order)) for j in range(i + 1, len(order)))
        product = Fraction(-1 if swaps % 2 else 1)
        for row, column in enumerate(order):
            product *= rows[row][column]
        total += product
    return total


def is_clearly_definite(matrix: np.ndarray) -> bool:
    rows = [[Fraction(value) for value in row] for row in matrix.tolist()]
    for i, row in enumerate(rows):
        row[i] -= CLEARLY * row[i]
    return all(determinant([row[:n] for row in rows[:n]]) > 0 for n in range(1, len(rows) + 1))


def moderate(matrix: np.ndarray) -> bool:
    return all(float(SMALLEST) <= abs(value) <= float(LARGEST) for value in matrix.ravel().tolist() if value)


def near_the_border(rng: Random, d: int) -> np.ndarray:
    """Return I − (1 − δ) u uᵀ with other units on its axes, δ about 2⁻⁴⁶, and some last bits changed."""
    u = np.array([rng.gauss(0, 1) for _ in range(d)])
    u /= np.linalg.norm(u)
    delta = rng.choice((1, -1)) * rng.choice((0.0, 1.0)) * 2.0 ** -rng.uniform(40, 52) + rng.choice(
        (0, 2**-46)
    )
    units = np.array([10.0 ** rng.uniform(-3, 3) for _ in range(d)]) * 10.0 ** (
        rng.choice((0, 0, 48.5, -48.5))
    )
    matrix = units[:, None] * (np.eye(d) - (1 - delta) * np.outer(u, u)) * units
    matrix = np.triu(matrix) + np.triu(matrix, 1).T
    i, j = rng.randrange(d), rng.randrange(d)
    matrix[i, j] = matrix[j, i] = np.nextafter(matrix[i, j], rng.choice((-np.inf, np.inf)))
    return matrix


def tried(rng: Random, goods: dict[str, bytes]) -> tuple[str, str]:
    """Return what the reader should do with one file, and what it does."""
    good = goods[rng.choice(SPECIMENS)]
    file = BytesIO(good)
    with h5py.File(file, "r+") as body:
        found: list[str] = []
        body.visit(lambda path: found.append(path) if path.split("/")[-1] in PLACES else None)
        values = body[path := rng.choice(found)][()]
        index = tuple(rng.randrange(n) for n in values.shape[:-2])
        values[index] = matrix = near_the_border(rng, values.shape[-1])
        body[path][...] = values
    good_size = moderate(matrix) or not path.endswith("lyapunov")
    expected = "accepted" if is_clearly_definite(matrix) and good_size else "refused"
    try:
        store.decode(sealed_again(good[:SEAL] + file.getvalue()[SEAL:], *stated(good)))
    except ArtifactError as error:
        if "compute with" in str(error) and "covariances" in path:
            return "refused as extreme", "refused as extreme"
        known = "definite" in str(error) or "of a size" in str(error)
        return expected, "refused" if known else f"refused, because {error}"
    return expected, "accepted"


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    goods = {name: (ARCHIVE / name).read_bytes() for name in SPECIMENS}
    seen = Counter(tried(Random(f"{options.seed}/{index}"), goods) for index in range(options.count))
    for (expected, found), number in sorted(seen.items()):
        print(f"should be {expected}, was {found}: {number}")
    broken = sum(number for (expected, found), number in seen.items() if expected != found)
    print(f"{broken} broke a rule")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
