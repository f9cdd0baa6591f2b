"""Files whose seal is intact because an attacker made it: the rules of the format must refuse them.

Every file here starts as a good artifact, is edited with h5py, and sealed again.
"""

import json
import shutil
import struct
import subprocess
import sys
import time
from io import BytesIO

import h5py
import numpy as np
import pytest
from h5py import h5a, h5d, h5g, h5p, h5s, h5t

from skillctl import store
from skillctl.errors import ArtifactError
from skillctl.store import errors
from skillctl.store.layout import ARRAYS, MAX_TOTAL_BYTES, require_layout

MEANS = "model/means"


def refuse(data: bytes, cause: str, kind: type[ArtifactError] = errors.InvalidArtifactError) -> None:
    start = time.monotonic()
    with pytest.raises(kind, match=cause) as caught:
        store.decode(data, "hostile.h5")
    assert time.monotonic() - start < 1  # [s]
    message = str(caught.value)
    assert message.startswith("hostile.h5 ")
    assert message.isprintable()
    assert len(message) < 500
    assert caught.value.hint


def replaced(path: str, **options):
    """An edit that writes a dataset again, in another way; data defaults to what it was."""

    def edit(body: h5py.File) -> None:
        options.setdefault("data", body[path][()])
        del body[path]
        body.create_dataset(path, **{"track_times": False, **options})

    return edit


def created(path: str, file_type, space, plist=None):
    """An edit that makes a dataset from low-level parts, without data."""

    def edit(body: h5py.File) -> None:
        del body[path]
        h5d.create(body.id, path.encode(), file_type, space, plist)

    return edit


# Links and objects


def external_link(body):
    del body[MEANS]
    body[MEANS] = h5py.ExternalLink("/etc/passwd", "/")


def soft_link(body):
    del body[MEANS]
    body[MEANS] = h5py.SoftLink("/model/priors")


def dangling_soft_group(body):
    del body["model"]
    body["model"] = h5py.SoftLink("/nowhere")


def same_object_twice(body):
    del body["model/covariances"]
    body["model/covariances"] = body["model/system_matrices"]


def cycle_to_the_root(body):
    del body["demonstrations"]
    body["demonstrations"] = body["/"]


def group_in_place_of_dataset(body):
    del body[MEANS]
    body.create_group(MEANS)


def dataset_in_place_of_group(body):
    del body["model"]
    body["model"] = np.zeros(3)


def named_type(body):
    del body[MEANS]
    body[MEANS] = np.dtype("<f8")


def committed_type(body):
    values = body[MEANS][()]
    del body[MEANS]
    kind = h5t.IEEE_F64LE.copy()
    kind.commit(body.id, b"hidden")
    made = h5d.create(body.id, MEANS.encode(), kind, h5s.create_simple(values.shape))
    made.write(h5s.ALL, h5s.ALL, values)
    del body["hidden"]


@pytest.mark.parametrize(
    ("edit", "cause"),
    [
        (external_link, "/model/means: a soft, external or user-defined link"),
        (soft_link, "/model/means: a soft, external or user-defined link"),
        (dangling_soft_group, "/model: a soft, external or user-defined link"),
        (same_object_twice, "/model/system_matrices: the same object as another member"),
        (cycle_to_the_root, "/demonstrations: the same object as another member"),
        (group_in_place_of_dataset, "/model/means: must be a dataset"),
        (dataset_in_place_of_group, "/model: must be a group"),
        (named_type, "/model/means: must be a dataset"),
        (committed_type, "/model/means: elements must be <f8"),
    ],
)
def test_links_and_objects(hostile, edit, cause):
    refuse(hostile(edit), cause)


def test_a_user_defined_link(hostile, reseal):
    def edit(body):
        del body["demonstrations/times"]
        body["demonstrations/times"] = h5py.ExternalLink("elsewhere.h5", "/")

    external, user_defined = b"\x40\x05times", b"\x41\x05times"  # type of the link, length of its name, name
    body = hostile(edit)[512:]
    assert body.count(external) == 1
    refuse(reseal(body.replace(external, user_defined)), "/demonstrations/times: .* user-defined link")


# Storage


def contiguous_in(*files):
    plist = h5p.create(h5p.DATASET_CREATE)
    for name, size in files:
        plist.set_external(name, 0, size)
    return plist


def virtual(body):
    shape = body[MEANS].shape
    layout = h5py.VirtualLayout(shape, "<f8")
    layout[:] = h5py.VirtualSource("/etc/passwd", "data", shape)
    del body[MEANS]
    body.create_virtual_dataset(MEANS, layout)


def compact(body):
    values = body[MEANS][()]
    plist = h5p.create(h5p.DATASET_CREATE)
    plist.set_layout(h5d.COMPACT)
    del body[MEANS]
    space = h5s.create_simple(values.shape)
    h5d.create(body.id, MEANS.encode(), h5t.IEEE_F64LE, space, plist).write(h5s.ALL, h5s.ALL, values)


def unwritten(path, shape, kind=h5t.IEEE_F64LE):
    return created(path, kind, h5s.create_simple(shape))


@pytest.mark.parametrize(
    ("edit", "cause"),
    [
        (virtual, "must be contiguous"),
        (compact, "must be contiguous"),
        (replaced(MEANS, chunks=True), "must be contiguous"),
        (replaced(MEANS, compression="gzip"), "must not be compressed or filtered"),
        (replaced(MEANS, shuffle=True), "must not be compressed or filtered"),
        (replaced(MEANS, fletcher32=True), "must not be compressed or filtered"),
        (replaced(MEANS, maxshape=(None, 2)), "must be contiguous"),
        (unwritten("demonstrations/positions", (2**20, 2)), "does not hold all of the array|N is"),
        (unwritten("demonstrations/positions", (2**39, 2)), r"N = 549755813888 is not within 1 to 4194304"),
        (unwritten("model/lyapunov", (2**62, 2, 2)), r"L = 4611686018427387904 is not within"),
    ],
)
def test_storage(hostile, edit, cause):
    refuse(hostile(edit), cause)


def test_an_extensible_array_is_refused(good, reseal):
    """HDF5 makes no extensible contiguous array, so the largest dimensions are changed in the file."""
    fixed, extensible = struct.pack("<4Q", 11, 2, 11, 2), struct.pack("<4Q", 11, 2, 99, 2)
    assert good.count(fixed) == 1  # the dimensions of /model/means
    refuse(reseal(good[512:].replace(fixed, extensible)), "/model/means: must not be extensible")


def test_an_array_that_is_not_in_the_file_is_refused(hostile):
    def edit(body):
        shape = body[MEANS].shape
        unwritten(MEANS, shape)(body)

    refuse(hostile(edit), "/model/means: the file does not hold all of the array")


def external_storage(target, size=1024):
    def edit(body):
        shape = body[MEANS].shape
        created(MEANS, h5t.IEEE_F64LE, h5s.create_simple(shape), contiguous_in((target.encode(), size)))(body)

    return edit


def test_external_storage_is_refused(hostile):
    refuse(hostile(external_storage("/etc/passwd")), "/model/means: its data would come from another file")


def test_external_storage_is_never_opened(hostile, tmp_path):
    if shutil.which("strace") is None:
        pytest.skip("strace is not installed")
    target = tmp_path / "secret-target"
    target.write_bytes(bytes(4096))
    (path := tmp_path / "skill.h5").write_bytes(hostile(external_storage(str(target))))
    code = "import sys; from skillctl import store; store.read_skill(sys.argv[1])"
    command = ["strace", "-f", "-e", "trace=open,openat,openat2", sys.executable, "-c", code, str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    if "skill.h5" not in run.stderr.split("Traceback")[0]:
        pytest.skip("strace may not trace here")
    assert "would come from another file" in run.stderr
    assert "secret-target" not in run.stderr


def test_a_planted_filter_plugin_is_not_loaded(hostile, tmp_path):
    """A shared library that leaves a mark when loaded, offered to HDF5 for an unknown filter."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler to make a plugin with")
    mark = tmp_path / "loaded"
    source = tmp_path / "plugin.c"
    source.write_text(
        "#include <stdio.h>\n__attribute__((constructor)) static void f(void) "
        f'{{ FILE *m = fopen("{mark}", "w"); if (m) fclose(m); }}\n'
    )
    (plugins := tmp_path / "plugins").mkdir()
    library = plugins / "libplanted.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", str(library), str(source)], check=True)

    def edit(body):
        shape = body[MEANS].shape
        plist = h5p.create(h5p.DATASET_CREATE)
        plist.set_chunk(shape)
        plist.set_filter(307, h5py.h5z.FLAG_OPTIONAL, (1,))  # optional: HDF5 writes without having it
        created(MEANS, h5t.IEEE_F64LE, h5s.create_simple(shape), plist)(body)

    (path := tmp_path / "skill.h5").write_bytes(hostile(edit))
    code = "import sys; from skillctl import store; store.read_skill(sys.argv[1])"
    run = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        capture_output=True, text=True, check=False, timeout=60, env={"HDF5_PLUGIN_PATH": str(plugins)},
    )  # fmt: skip
    assert "must not be compressed or filtered" in run.stderr
    assert not mark.exists()


def test_all_arrays_together_are_limited(hostile):
    """Each of these just fits; together they do not."""
    k, d = 4096, 32
    shapes = {
        "model/priors": (k,), "model/means": (k, d), "model/covariances": (k, d, d),
        "model/system_matrices": (k, d, d), "model/residual_covariances": (k, d, d),
        "model/attractors": (1, d), "model/lyapunov": (1, d, d), "model/density_priors": (k,),
        "model/density_means": (k, d), "model/density_covariances": (k, d, d),
    }  # fmt: skip
    assert sum(np.prod(shape) * 8 for shape in shapes.values()) > MAX_TOTAL_BYTES

    def edit(body):
        del body["demonstrations"]
        for path, shape in shapes.items():
            unwritten(path, shape)(body)

    refuse(hostile(edit), "all arrays together are larger than 128 MiB")


def test_one_array_is_limited():
    with pytest.raises(errors.Refusal, match="larger than 32 MiB"):
        require_layout({"model/covariances": (4096, 33, 33)})


def test_a_thousand_datasets_are_refused_unread(hostile):
    def edit(body):
        for index in range(1000):
            h5d.create(body.id, b"d%d" % index, h5t.IEEE_F64LE, h5s.create_simple((2**21,)))

    refuse(hostile(edit), "/: 1003 members; the format has 3")


# Element types


COMPOUND = np.dtype([("a", "<f4"), ("b", "<f4")])


def odd_float():
    kind = h5t.IEEE_F64LE.copy()
    kind.set_ebias(1000)
    return kind


@pytest.mark.parametrize("kind", [
    h5t.IEEE_F64BE, h5t.IEEE_F32LE, h5t.IEEE_F16LE, h5t.STD_I64LE, h5t.STD_U64LE, odd_float(),
    h5t.py_create(COMPOUND), h5t.STD_REF_OBJ, h5t.STD_REF_DSETREG, h5t.create(h5t.OPAQUE, 8),
    h5t.py_create(h5py.string_dtype(), logical=True), h5t.py_create(h5py.vlen_dtype(float), logical=True),
    h5t.py_create(h5py.enum_dtype({"a": 1}, "<i8")), h5t.array_create(h5t.IEEE_F64LE, (2,)),
    h5t.py_create(np.dtype("S8")),
], ids=[
    "big-endian", "f4", "f2", "i8", "u8", "odd float", "compound", "reference", "region", "opaque",
    "variable-length text", "variable-length array", "enum", "array", "text",
])  # fmt: skip
def test_element_types(hostile, kind):
    refuse(hostile(created(MEANS, kind, h5s.create_simple((10, 2)))), "/model/means: elements must be <f8")


@pytest.mark.parametrize(("path", "kind"), [
    ("demonstrations/offsets", h5t.STD_I32LE), ("demonstrations/offsets", h5t.STD_I64BE),
    ("demonstrations/part", h5t.IEEE_F64LE), ("meta.json", h5t.STD_I8LE), ("meta.json", h5t.STD_U8BE),
])  # fmt: skip
def test_integer_types(hostile, path, kind):
    data = hostile(created(path, kind, h5s.create_simple((4,))))
    if kind == h5t.STD_U8BE:  # one byte has no order: HDF5 still tells the two types apart
        refuse(data, "elements must be <u1|does not hold")
    else:
        refuse(data, f"/{path}: elements must be")


# Amount and names


def many_groups(body):
    group = body.id
    for _ in range(10_000):
        group = h5g.create(group, b"g")


def many_members(body):
    crowd = h5g.create(body["demonstrations"].id, b"crowd")
    for index in range(50_000):
        crowd.links.create_hard(b"%05d" % index, body.id, b"meta.json")
    body.id.links.move(b"model", crowd, b"model")
    body.id.links.move(b"demonstrations/crowd", body.id, b"model")


def many_attributes(body):
    body.id.unlink(b"model")
    group = h5g.create(body.id, b"model")
    space = h5s.create(h5s.SCALAR)
    for index in range(20_000):
        h5a.create(group, b"%05d" % index, h5t.STD_U8LE, space)


@pytest.mark.parametrize(
    ("edit", "options", "cause"),
    [
        (many_groups, {}, "/g: not part of the format"),
        (many_members, {}, "/model/: 50001 members; the format has 10"),
        (many_attributes, {"libver": "latest"}, "/model: must not have attributes"),
    ],
)
def test_amounts(hostile, edit, options, cause):
    refuse(hostile(edit, **options), cause)


@pytest.mark.parametrize("name", [
    b"..", b".hidden", b"\x1b[2J", b"line\nbreak", "\u202egnp.h5".encode(), b"x" * 60_000, b"\xff\xfe",
    b"MEANS", b"Means", "m\u00e9ans".encode(), b"means ",
], ids=repr)  # fmt: skip
@pytest.mark.parametrize("place", ["", "model/", "demonstrations/"])
def test_names(hostile, place, name):
    def edit(body):  # in place of a member, so that numbers agree
        group = body[place or "/"]
        old = {"": "meta.json", "model/": "means", "demonstrations/": "times"}[place]
        group.id.links.move(old.encode(), group.id, name)

    refuse(hostile(edit, libver="latest"), "not part of the format|HDF5 cannot read it")


@pytest.mark.parametrize("path", ["meta.json", "model", "model/density_priors", "demonstrations/times"])
def test_missing_members(hostile, path):
    def edit(body):
        del body[path]

    refuse(hostile(edit), "missing|of the format|the format has")


def test_missing_demonstrations_are_noticed_in_the_metadata(hostile):
    def edit(body):
        del body["demonstrations"]

    refuse(hostile(edit), "demonstrations: the file holds none")


@pytest.mark.parametrize("path", ["/", "model", MEANS, "meta.json"])
def test_attributes(hostile, path):
    def edit(body):
        body[path].attrs["note"] = 1

    refuse(hostile(edit), "attribute")


# Numbers


def changed(path, index, value):
    def edit(body):
        body[path][index] = value

    return edit


NUMBERS = [
    "model/priors", "model/means", "model/covariances", "model/system_matrices", "model/residual_covariances",
    "model/attractors", "model/lyapunov", "model/density_priors", "model/density_means",
    "model/density_covariances", "demonstrations/positions", "demonstrations/times",
]  # fmt: skip


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("path", NUMBERS)
def test_numbers_must_be_finite(hostile, path, value):
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
    (scaled_by(1e-311), "leaf 0: means and covariances: too large or too small"),
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
def test_numbers_must_form_a_skill(hostile, edit, cause, recwarn):
    refuse(hostile(edit), cause)
    assert not recwarn.list


def test_an_unstable_skill_is_read(hostile):
    """Whether a skill is stable is for the proof to say, not for the reader."""

    def edit(body):
        body["model/system_matrices"][0] = np.zeros((2, 2))
        body["model/system_matrices"][1] = np.eye(2)
        body["model/system_matrices"][2] = np.array([[-1.0, 1e-300], [-1e-300, -5e-324]])

    read = store.decode(hostile(edit, honest=True))
    assert (read.skill.leaves[0].system_matrices[1] == np.eye(2)).all()


# Shapes


@pytest.mark.parametrize(
    ("path", "values", "cause"),
    [
        (MEANS, np.zeros((9, 2)), "K is 9 here and 11 elsewhere"),
        (MEANS, np.zeros((11, 3)), "d is"),
        (MEANS, np.zeros(8), "expected 2 axes, found 1"),
        (MEANS, np.zeros((1, 1, 1, 1, 1)), "expected 2 axes, found 5"),
        (MEANS, np.float64(1), "must be an array"),
        (MEANS, h5py.Empty("<f8"), "must be an array|contiguous"),
        (MEANS, np.zeros((0, 2)), "K = 0 is not within|hold"),
        ("model/lyapunov", np.zeros((4, 2, 3)), "d is"),
        ("model/attractors", np.zeros((5, 2)), "L is"),
        ("model/density_priors", np.full(3, 1 / 3), "M is"),
        ("demonstrations/part", np.zeros(2, "<i8"), "D.1 is 7, but D is 2"),
        ("demonstrations/times", np.zeros(5), "N is"),
    ],
)
def test_shapes(hostile, path, values, cause):
    refuse(hostile(replaced(path, data=values)), cause)


# Metadata


@pytest.fixture(scope="module")
def meta(good):
    with h5py.File(BytesIO(good)) as body:
        return json.loads(body["meta.json"][()].tobytes())


def spelled(meta, old, new):
    text = json.dumps(meta)
    assert text.count(old) == 1, text.count(old)
    return text.replace(old, new).encode()


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (b'{"a": "\xff"}', "not UTF-8"),
        (b'{"a": "\xed\xa0\x80"}', "not UTF-8"),
        (b'{"a": "\x00"}', "not JSON"),
        (b"{} {}", "not JSON"),
        (b"{}\0", "not JSON"),
        (b"\xef\xbb\xbf{}", "not JSON"),
        (b"[1]", "not an object"),
        (b"null", "not an object"),
        (b"[" * 65_000, "nested more than 64 deep"),
        (b'{"a":' * 13_000, "nested more than 64 deep"),
        (b'{"a": 1, "b": {"x": 1, "x": 2}}', "key 'x' occurs twice"),
        (b'{"a": NaN}', "NaN is not JSON"),
        (b'{"a": -Infinity}', "-Infinity is not JSON"),
        (b'{"a": 1e999}', "does not fit float64"),
        (b'{"a": ' + b"9" * 10_000 + b"}", "does not fit int64"),
        (b'{"a": 9223372036854775808}', "does not fit int64"),
        (b"{" + b" " * 65_536, "B = 65537 is not within 1 to 65536"),
        (b'{"format": 1}', r"/meta\.json: skill: Field required"),
    ],
)
def test_metadata_is_strict_json(with_meta, text, cause):
    refuse(with_meta(text), cause)


@pytest.mark.parametrize(("old", "new", "cause"), [
    ('"frame": "base", ', "", "state.frame: Field required"),
    ('"frame": "base"', '"frame": "base", "extra": 1', "state.extra: Extra inputs are not permitted"),
    ('"frame": "base"', '"frame": "base", "\\u001b[2J": 1', "Extra inputs are not permitted"),
    ('"frame": "base"', '"frame": "\\u001b[2J"', "state.frame: must not contain control characters"),
    ('"frame": "base"', '"frame": "\\ud800"', "state.frame: "),
    ('"frame": "base"', '"frame": ""', "state.frame: "),
    ('"frame": "base"', f'"frame": "{"x" * 201}"', "state.frame: "),
    ('"names": ["x", "y"]', '"names": ["x", "x"]', "expected 2 different names"),
    ('"names": ["x", "y"]', '"names": ["x"]', "expected 2 different names"),
    ('"names": ["x", "y"]', '"names": "xy"', "state.names: "),
    ('"seed": 7', '"seed": 7.0', "operation.seed: "),
    ('"seed": 7', '"seed": true', "operation.seed: "),
    ('"seed": 7', '"seed": "7"', "operation.seed: "),
    ('"seed": 7', '"seed": -1', "operation.seed: "),
    ('"kind": "combined"', '"kind": "seds"', "skill"),
    ('"kind": "combined"', '"kind": "average"', "skill"),
    ('"gate": "instantaneous"', '"gate": "sometimes"', "gate"),
    ('"sharpness": 2.5', '"sharpness": 0.5', "sharpness"),
    ('"speed": 0.9', '"speed": 0', "speed"),
    ('"speed": 0.9', '"speed": -0.9', "speed"),
    ('"part_priors": [0.5, 0.5]', '"part_priors": [0.5, 0.4]', "part_priors: must be positive and sum"),
    ('"part_priors": [0.5, 0.5]', '"part_priors": [1.0]', "part_priors: expected shape"),
    ('"part_priors": [0.5, 0.5]', '"part_priors": []', "part_priors"),
    ('"components": [0, 3]', '"components": [0, 2]', "does not continue"),
    ('"components": [0, 3]', '"components": [3, 0]', "does not continue"),
    ('"components": [0, 3]', '"components": [0, 3, 3]', "components"),
    ('"components": [0, 3]', '"components": [0, 0]', "does not continue|means: expected shape"),
    ('"components": [0, 3]', '"components": [0, 1000000000]', "does not continue|components"),
    ('"leaf": 0, "speed"', '"leaf": 1, "speed"', "leaf 1 does not continue"),
    ('"path": "data/motion.csv"', '"path": "/etc/passwd"', "relative path"),
    ('"path": "data/motion.csv"', '"path": "../secret"', "relative path"),
    ('"path": "data/motion.csv"', '"path": "C:\\\\secret"', "relative path"),
    (f'"sha256": "{"0" * 64}"', '"sha256": "0"', "sha256"),
    (f'"sha256": "{"0" * 64}"', f'"sha256": "{"0" * 64}\\n"', "sha256"),
    ('"command": "combine"', '"command": "rm -rf"', "operation.command"),
    ('"date": null', '"date": "yesterday"', "provenance.date"),
    ('"date": null', '"date": "2020-02-29T12:00:00"', "provenance.date"),
    ('["x", "y"], "unit": "m"', '["x", "y"], "unit": "mm"', "state.unit"),
    ('"kind": "euclidean"', '"kind": "quaternion"', "state.kind"),
    ('"unit": "m"}, "results"', '"Unit": "m"}, "results"', "operation.options"),
    ('"unit": "m"}, "results"', f'"{"u" * 65}": "m"}}, "results"', "operation.options"),
    ('"unit": "m"}, "results"', '"unit": {"m": 1}}, "results"', "operation.options"),
    ('"unit": "m"}, "results"', '"unit": [["m"]]}, "results"', "operation.options"),
    ('"unit": "m"}, "results"', f'"unit": "{"m" * 1001}"}}, "results"', "operation.options"),
    ('"disturbance_distance": 0.1', '"disturbance_distance": 0', "disturbance_distance"),
    ('"part_weights": [0.3, 0.7]', '"part_weights": [0.3, 0.6]', "part_weights: must be positive and sum"),
    ('"part_weights": [0.3, 0.7]', '"part_weights": [-0.3, 1.3]', "part_weights"),
    ('"importer": "csv"', '"importer": ""', "importer"),
    ('"version": 3', '"version": 0', "version"),
    ('"version": 3', '"version": 1000000', "version"),
    ('"role": "part"', '"role": ""', "role"),
    (f'"digest": "sha256:{"1" * 64}"', f'"digest": "{"1" * 64}"', "digest"),
    ('"numpy": "2.0.0"', '"numpy": 2', "libraries"),
    ('"tool": "0.1.0"', '"tool": ""', "provenance.tool"),
])  # fmt: skip
def test_metadata_has_exactly_the_fields_of_the_format(with_meta, meta, old, new, cause):
    refuse(with_meta(spelled(meta, old, new)), f"/meta.json: .*{cause}|{cause}")


@pytest.mark.parametrize("change", [
    {"n_points": 1}, {"duration": 0}, {"dtw": -1e-9}, {"end_error": -1}, {"velocity_rmse": -1},
    {"arrived": 1}, {"leaf": -1}, {"source": "x" * 201}, {"extra": 1},
], ids=repr)  # fmt: skip
def test_reports_have_exactly_the_fields_of_the_format(with_meta, meta, change):
    reports = [{**meta["reports"][0], **change}]
    refuse(with_meta(json.dumps({**meta, "reports": reports}).encode()), f"reports.0.{next(iter(change))}")


@pytest.mark.parametrize("note", ["", "x" * 1001, "a\nb", 1])
def test_notes_are_short_texts(with_meta, meta, note):
    operation = {**meta["operation"], "note": note}
    refuse(with_meta(json.dumps({**meta, "operation": operation}).encode()), "operation.note")


def test_what_may_be_left_out_may_and_a_whole_number_is_a_float(with_meta, meta):
    operation = {"command": meta["operation"]["command"]}
    less = {
        **meta,
        "operation": operation,
        "provenance": {"tool": "x"},
        "skill": {**meta["skill"], "speed": 1},
    }
    del less["reports"]
    read = store.decode(with_meta(json.dumps(less, indent=3).encode(), honest=True))
    assert (read.reports, read.operation.options, read.operation.seed, read.skill.speed) == (
        (),
        {},
        None,
        1.0,
    )
    assert (read.provenance.inputs, read.provenance.parents, read.provenance.libraries) == ((), (), {})


@pytest.mark.parametrize("key", ["skill", "state", "operation", "provenance"])
def test_nothing_else_may_be_left_out(with_meta, meta, key):
    refuse(
        with_meta(json.dumps({k: v for k, v in meta.items() if k != key}).encode()), f"{key}: Field required"
    )


@pytest.mark.parametrize(
    ("length", "most"),
    [("K", 4096), ("M", 4096), ("L", 256), ("d", 64), ("D", 4096), ("N", 4194304), ("B", 65536)],
)
def test_every_length_has_its_limit(length, most):
    path = next(path for path, spec in ARRAYS.items() if length in spec.lengths)

    def shape(size):
        return tuple(size if name == length else 1 for name in ARRAYS[path].lengths)

    partner = {"demonstrations/offsets": (most + 1,)} if length == "D" else {}
    require_layout({path: shape(most), **partner})
    for size in (0, most + 1):
        with pytest.raises(errors.Refusal, match=f"{length} = {size} is not within 1 to {most}"):
            require_layout({path: shape(size)})


def test_weights_may_miss_one_by_rounding_only(hostile):
    def shifted(ulps):
        def edit(body):
            priors = body["model/priors"][()]
            priors[0] += 1 - priors[:3].sum() + ulps * 2.0**-52  # the leaf's three
            body["model/priors"][...] = priors

        return edit

    store.decode(hostile(shifted(20), honest=True))
    refuse(hostile(shifted(30)), "leaf 0: priors: must be positive and sum to one")  # 8 n = 24


def test_a_demonstration_that_never_moves(hostile):
    def edit(body):
        rows = slice(*body["demonstrations/offsets"][:2])
        body["demonstrations/positions"][rows] = 0.5

    refuse(hostile(edit), "motion-0.csv#0")


def test_a_report_on_a_leaf_that_is_not_there(with_meta, meta):
    reports = [{**meta["reports"][0], "leaf": 4}]
    refuse(with_meta(json.dumps({**meta, "reports": reports}).encode()), "there is no leaf 4")


def test_sources_and_demonstrations_must_agree(with_meta, meta):
    refuse(with_meta(json.dumps({**meta, "demonstrations": []}).encode()), "expected 6 sources")


def test_a_combined_skill_is_no_part(with_meta, meta):
    skill = {**meta["skill"], "parts": [meta["skill"]], "part_priors": [1.0]}
    refuse(with_meta(json.dumps({**meta, "skill": skill}).encode()), "skill")


def test_a_tree_may_be_16_deep_and_no_deeper(with_meta, meta):
    def deep(extra):
        skill = meta["skill"]  # combined, merged, merged, seds: four deep
        first = skill["parts"][0]
        for _ in range(extra):
            first = {"kind": "merged", "parts": [first], "part_weights": [1.0], "gate": "density",
                     "sharpness": 1.0, "speed": 1.0}  # fmt: skip
        return json.dumps({**meta, "skill": {**skill, "parts": [first, skill["parts"][1]]}}).encode()

    store.decode(with_meta(deep(12), honest=True))
    refuse(with_meta(deep(13)), "nested more than 16 deep")


# What the seal states


@pytest.mark.parametrize("kind", ["seds", "merged"])
def test_a_seal_that_states_another_kind(good, reseal, page_digest, kind):
    digest = page_digest(good[512:])
    assert reseal(good[512:], "combined", digest) == good
    refuse(reseal(good[512:], kind, digest), f"its seal states a kind of {kind}, but it holds combined")


def test_a_seal_that_states_another_digest(good, reseal):
    data = reseal(good[512:])
    refuse(data, f"its seal states a digest of sha256:{'0' * 64}, but it holds sha256:")
    with pytest.raises(errors.InvalidArtifactError, match="states a digest"):
        store.digest_of(data)


# Format versions


@pytest.mark.parametrize(
    ("version", "kind", "cause"),
    [
        (2, errors.TooNewFormatError, "has skill format 2; this build reads format 1"),
        (999, errors.TooNewFormatError, "has skill format 999; this build reads format 1"),
        (0, errors.TooOldFormatError, "has skill format 0; this build reads format 1"),
        ("1.0", errors.InvalidArtifactError, "format version '1.0', not a whole number; this build reads 1"),
        (1.0, errors.InvalidArtifactError, "format version '1.0', not a whole number; this build reads 1"),
        (True, errors.InvalidArtifactError, "format version 'True', not a whole number; this build reads 1"),
        (None, errors.InvalidArtifactError, "no format version, not a whole number; this build reads 1"),
        ("\x1b[2J" * 99, errors.InvalidArtifactError, "not a whole number; this build reads 1"),
    ],
)
def test_versions_in_the_metadata(with_meta, meta, version, kind, cause):
    refuse(with_meta(json.dumps({**meta, "format": version}).encode()), cause, kind)


def test_a_missing_version_in_the_metadata(with_meta, meta):
    del (without := dict(meta))["format"]
    refuse(with_meta(json.dumps(without).encode()), "states no format version")


@pytest.mark.parametrize(
    ("mark", "kind", "cause"),
    [
        (np.bytes_("skill-v2"), errors.TooNewFormatError, "has skill format 2; this build reads format 1"),
        (np.bytes_("skill-v0"), errors.TooOldFormatError, "has skill format 0; this build reads format 1"),
        (np.bytes_("skill-v1.0"), errors.InvalidArtifactError, "'skill-v1.0', not a whole number"),
        (np.bytes_("skill-v01"), errors.InvalidArtifactError, "must be skill-v1"),
        (np.bytes_("\x1b[2J"), errors.InvalidArtifactError, "not a whole number"),
        (np.bytes_("x" * 1000), errors.InvalidArtifactError, "short text of fixed length"),
        ("skill-v1", errors.InvalidArtifactError, "short text of fixed length"),
        (1, errors.InvalidArtifactError, "short text of fixed length"),
        (np.array([b"skill-v1"]), errors.InvalidArtifactError, "short text of fixed length"),
        (None, errors.InvalidArtifactError, "must have one attribute"),
    ],
)
def test_versions_in_the_body(hostile, mark, kind, cause):
    def edit(body):
        del body.attrs["format"]
        if mark is not None:
            body.attrs["format"] = mark

    refuse(hostile(edit), cause, kind)


@pytest.mark.parametrize(
    ("version", "kind", "cause"),
    [
        (b"2", errors.TooNewFormatError, "has skill format 2; this build reads format 1"),
        (b"0", errors.TooOldFormatError, "has skill format 0; this build reads format 1"),
        (b"01", errors.DamagedArtifactError, "do not match its seal"),
        (b"1.0", errors.DamagedArtifactError, r"not a seal \(format 1\)"),
        (b"", errors.DamagedArtifactError, r"not a seal \(format 1\)"),
    ],
)
def test_versions_in_the_seal(good, version, kind, cause):
    head = good[:10] + version + good[11:]
    data = head[:512] + good[512:] if len(head) <= len(good) else head[:511] + b"\0" + good[512:]
    with pytest.raises(kind, match=cause):
        store.decode(data.ljust(len(good), b"\0"), "later.h5")
