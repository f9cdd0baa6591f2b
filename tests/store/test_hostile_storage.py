"""Files that are sealed again with arrays stored in another way, of other elements, shapes and sizes."""

import shutil
import struct
import subprocess
import sys

import h5py
import numpy as np
import pytest
from h5py import h5d, h5p, h5s, h5t

from skillctl.store import errors
from skillctl.store.layout import ARRAYS, MAX_TOTAL_BYTES, require_layout

MEANS = "model/means"


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
def test_storage(refuse, hostile, edit, cause):
    refuse(hostile(edit), cause)


def test_an_extensible_array_is_refused(refuse, good, reseal):
    """HDF5 makes no extensible contiguous array, so the largest dimensions are changed in the file."""
    fixed, extensible = struct.pack("<4Q", 11, 2, 11, 2), struct.pack("<4Q", 11, 2, 99, 2)
    assert good.count(fixed) == 1  # the dimensions of /model/means
    refuse(reseal(good[512:].replace(fixed, extensible)), "/model/means: must not be extensible")


def test_an_array_that_is_not_in_the_file_is_refused(refuse, hostile):
    def edit(body):
        shape = body[MEANS].shape
        unwritten(MEANS, shape)(body)

    refuse(hostile(edit), "/model/means: the file does not hold all of the array")


def external_storage(target, size=1024):
    def edit(body):
        shape = body[MEANS].shape
        created(MEANS, h5t.IEEE_F64LE, h5s.create_simple(shape), contiguous_in((target.encode(), size)))(body)

    return edit


def test_external_storage_is_refused(refuse, hostile):
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


def test_all_arrays_together_are_limited(refuse, hostile):
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
        del body["demonstrations"], body["golden"]
        for path, shape in shapes.items():
            unwritten(path, shape)(body)

    refuse(hostile(edit), "all arrays together are larger than 128 MiB")


def test_one_array_is_limited():
    with pytest.raises(errors.Refusal, match="larger than 32 MiB"):
        require_layout({"model/covariances": (4096, 33, 33)})


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
def test_element_types(refuse, hostile, kind):
    refuse(hostile(created(MEANS, kind, h5s.create_simple((10, 2)))), "/model/means: elements must be <f8")


@pytest.mark.parametrize(("path", "kind"), [
    ("demonstrations/offsets", h5t.STD_I32LE), ("demonstrations/offsets", h5t.STD_I64BE),
    ("demonstrations/part", h5t.IEEE_F64LE), ("meta.json", h5t.STD_I8LE), ("meta.json", h5t.STD_U8BE),
])  # fmt: skip
def test_integer_types(refuse, hostile, path, kind):
    data = hostile(created(path, kind, h5s.create_simple((4,))))
    if kind == h5t.STD_U8BE:  # one byte has no order: HDF5 still tells the two types apart
        refuse(data, "elements must be <u1|does not hold")
    else:
        refuse(data, f"/{path}: elements must be")


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
def test_shapes(refuse, hostile, path, values, cause):
    refuse(hostile(replaced(path, data=values)), cause)


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
