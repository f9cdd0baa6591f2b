"""Ways to spoil what is in an artifact, with h5py: its arrays, its objects, its metadata."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from io import BytesIO
from random import Random
from typing import Any

import h5py
import numpy as np
from h5py import h5d, h5p, h5s, h5t
from mutations import SEAL, Mutation

# ---------------------------------------------------------------------------------------------------------
# Arrays, edited with h5py

NUMBERS = (
    0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 5e-324, 1e-310, 1e-300, 1e-160, 1e-30, 1e-9, 0.5,
    2.0, 1e9, 1e30, 1e160, 1e300, 1.7e308, -1.7e308,
)  # fmt: skip
INTEGERS = (-(2**63), -(2**31), -1, 0, 1, 2, 3, 255, 2**31, 2**62, 2**63 - 1)


def paths(body: h5py.File) -> list[str]:
    found: list[str] = []
    body.visititems(lambda path, item: found.append(path) if isinstance(item, h5py.Dataset) else None)
    return found


def edited(edit: Callable[[Random, h5py.File], None]) -> Mutation:
    """Return the mutation that opens a file with h5py and edits it."""

    def mutation(rng: Random, data: bytes, _: list[bytes]) -> bytes:
        file = BytesIO(data)
        with h5py.File(file, "r+") as body:
            edit(rng, body)
        return data[:SEAL] + file.getvalue()[SEAL:]

    mutation.__name__ = edit.__name__
    return mutation


def _one_number(rng: Random, values: np.ndarray) -> None:
    at = tuple(rng.randrange(n) for n in values.shape)
    if values.dtype.kind == "i":
        values[at] = rng.choice((*INTEGERS, int(values[at]) + rng.choice((-1, 1))))
    elif rng.random() < 0.5:
        values[at] = rng.choice(NUMBERS)
    else:
        values[at] = rng.choice((values[at] * rng.uniform(0.5, 2), np.nextafter(values[at], 9), -values[at]))


def _all_numbers(rng: Random, values: np.ndarray) -> None:
    """Scale, shift, or reorder all of an array; symmetric matrices stay symmetric."""
    with np.errstate(all="ignore"):
        match rng.randrange(5):
            case 0:
                values[...] = (
                    (values * rng.choice(NUMBERS)).astype(values.dtype) if values.dtype.kind == "f" else 0
                )
            case 1:
                values[...] = values[::-1].copy()
            case 2:
                values[rng.randrange(len(values))] = values[rng.randrange(len(values))]
            case 3:
                values[...] += rng.choice((1, -1))
            case 4:
                values[rng.randrange(len(values))] *= rng.choice((0, 1, 2, 1000))


@edited
def numbers(rng: Random, body: h5py.File) -> None:
    """Other numbers in an array, of the same type and shape."""
    for _ in range(rng.choice((1, 1, 2))):
        path = rng.choice([path for path in paths(body) if path != "meta.json"])
        values = body[path][()]
        rng.choice((_one_number, _all_numbers))(rng, values)
        body[path][...] = values


@edited
def scales(rng: Random, body: h5py.File) -> None:
    """The model in numbers of another order of magnitude: definite matrices stay so."""
    of_the_model = [path for path in paths(body) if path.startswith("model/") and "priors" not in path]
    with np.errstate(all="ignore"):
        for path in rng.sample(of_the_model, rng.choice((1, 1, 2, len(of_the_model)))):
            body[path][...] = body[path][()] * 10.0 ** rng.choice(
                (rng.uniform(-308, 308), rng.uniform(-30, 30))
            )


def _rewrite(body: h5py.File, path: str, values: Any, **options: Any) -> None:
    del body[path]
    body.create_dataset(path, data=values, **{"track_times": False, **options})


@edited
def shapes(rng: Random, body: h5py.File) -> None:
    """Another shape, type or storage of an array."""
    path = rng.choice(paths(body))
    values = body[path][()]
    match rng.randrange(9):
        case 0:
            _rewrite(body, path, values[: rng.randrange(len(values))])
        case 1:
            _rewrite(body, path, np.concatenate([values, values[:1]]))
        case 2:
            _rewrite(body, path, values[None])
        case 3:
            _rewrite(body, path, values.reshape(-1))
        case 4:
            kinds = ("f4", ">f8", "f2", "i4", ">i8", "u8", "i1", "?", "c16", "S8")
            with np.errstate(all="ignore"):
                _rewrite(body, path, values.astype(rng.choice(kinds)))
        case 5:
            _rewrite(body, path, values, **rng.choice(STORAGE))
        case 6:
            _rewrite(body, path, values.flat[0])
        case 7:
            del body[path]
            shape = tuple(rng.choice((0, 1, 2, 3, 64, 2**22, 2**40)) for _ in range(rng.randint(1, 4)))
            shape = shape if math.prod(shape) < 2**60 else shape[:1]
            h5d.create(body.id, path.encode(), h5t.IEEE_F64LE, h5s.create_simple(shape))
        case 8:
            _rewrite(body, path, np.swapaxes(values, 0, -1))


STORAGE: tuple[dict[str, Any], ...] = (
    {"chunks": True}, {"compression": "gzip"}, {"shuffle": True, "chunks": True}, {"fletcher32": True},
    {"maxshape": None, "chunks": True}, {"track_times": True}, {"fillvalue": 3},
)  # fmt: skip


@edited
def members(rng: Random, body: h5py.File) -> None:
    """Members and attributes that do not belong there, and missing ones."""
    path = rng.choice(paths(body))
    match rng.randrange(5):
        case 0:
            del body[rng.choice((path, path.split("/")[0]))]
        case 1:
            body.move(path, path + rng.choice(("2", " ", "\u202e", ".", "é")))
        case 2:
            body[rng.choice(("extra", "model/extra", "extra/a", "a/b/c/d"))] = np.zeros(3)
        case 3:
            body.create_group(rng.choice(("extra", "model/extra")))
        case 4:
            value = rng.choice(("x", 1, np.bytes_("skill-v1"), np.bytes_("skill-v3"), np.zeros(9), [b"a"]))
            body[rng.choice((path, "/", "/"))].attrs[rng.choice(("note", "format", "\x1b[2J"))] = value


@edited
def links(rng: Random, body: h5py.File) -> None:
    """A member that is another object, a link, an array elsewhere; or two arrays in each other's place."""
    path, other = rng.sample(paths(body), 2)
    values, other_values = body[path][()], body[other][()]
    del body[path]
    match rng.randrange(6):
        case 0:
            body[path] = h5py.SoftLink(f"/{other}")
        case 1:
            body[path] = h5py.ExternalLink("/etc/passwd", "/")
        case 2:
            body[path] = body[other]
        case 3:
            body[path] = rng.choice((body["/"], body["model"], np.dtype("f8")))
        case 4:
            body.create_dataset(path, data=other_values, track_times=False)
            _rewrite(body, other, values)
        case 5:
            plist = h5p.create(h5p.DATASET_CREATE)
            plist.set_external(b"/etc/passwd", 0, values.nbytes)
            kind, space = h5t.py_create(values.dtype), h5s.create_simple(values.shape)
            h5d.create(body.id, path.encode(), kind, space, plist)


# ---------------------------------------------------------------------------------------------------------
# Metadata

VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2**62, 2**70, 0.5, -0.5, 1e308, 1e-308, "", "x", "x" * 999, "\x1b[2J",
    "\u202e", "/etc/passwd", "../up", [], {}, [1], [[1]], {"x": 1},
)  # fmt: skip
TEXTS = (
    b'"', b"{", b"}", b"[", b"]", b",", b":", b"\\", b"\0", b"\xff", b" ", b"\n", b"1e999", b"NaN", b"-0",
    b"0", b"99999999999999999999", b"\\ud800", b"\\u0000", b"null", b"[" * 70, b"\xef\xbb\xbf",
)  # fmt: skip


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Return every (container, key) of a JSON value."""
    keys = value.keys() if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    return [place for key in keys for place in ((value, key), *_places(value[key]))]


def _edit_tree(rng: Random, meta: Any) -> None:
    container, key = rng.choice(_places(meta))
    match rng.randrange(6):
        case 0:
            container[key] = rng.choice(VALUES)
        case 1:
            del container[key]
        case 2 if isinstance(container, dict):
            container[rng.choice(("extra", "kind", "note", "speed", "x" * 99, "\x1b"))] = rng.choice(VALUES)
        case 3 if isinstance(container, list):
            container.insert(key, container[key])
        case 4 if isinstance(container[key], int | float) and not isinstance(container[key], bool):
            container[key] = rng.choice(
                (container[key] + 1, container[key] * 1.0000001, -container[key], 0.25)
            )
        case _:
            elsewhere, its_key = rng.choice(_places(meta))
            container[key] = json.loads(json.dumps(elsewhere[its_key]))


@edited
def metadata(rng: Random, body: h5py.File) -> None:
    """Other metadata: another value in the tree, or other characters in the text."""
    text = body["meta.json"][()].tobytes()
    if rng.random() < 0.6:
        meta = json.loads(text)
        for _ in range(rng.choice((1, 1, 2))):
            _edit_tree(rng, meta)
        text = json.dumps(meta, indent=rng.choice((None, None, 1))).encode()
    else:
        at = rng.randrange(len(text))
        text = text[:at] + rng.choice((rng.choice(TEXTS), rng.randbytes(1))) + text[at + rng.randint(0, 2) :]
    _rewrite(body, "meta.json", np.frombuffer(text or b"{}", np.uint8))


INSIDE: dict[str, Mutation] = {m.__name__: m for m in (numbers, scales, shapes, members, links, metadata)}
