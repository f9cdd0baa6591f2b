"""Skills of every kind, and hostile files made from good ones.

The seal of a hostile file is intact because an attacker made it: the rules of the format must refuse it.
"""

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO

import h5py
import numpy as np
import pytest

from skillctl import store
from skillctl.errors import ArtifactError
from skillctl.model.chained import ChainedSkill
from skillctl.model.combined import CombinedSkill
from skillctl.model.coordinates.chain import Chain, OnPosition
from skillctl.model.coordinates.shears import Shears
from skillctl.model.demonstration import Demonstration, DemonstrationSet
from skillctl.model.golden import GoldenMotions
from skillctl.model.merged import MergedSkill
from skillctl.model.mixture import GaussianMixture
from skillctl.model.pose import Pose
from skillctl.model.seds import SedsSkill
from skillctl.model.skill import Skill
from skillctl.model.space import Euclidean, Space
from skillctl.store import errors


def definite(rng: np.random.Generator, n: int, d: int) -> np.ndarray:
    factors = rng.normal(size=(n, d, d))
    product = factors @ factors.swapaxes(1, 2) + np.eye(d)
    return (product + product.swapaxes(1, 2)) / 2  # exactly symmetric


def seds(seed: int, d: int = 2, k: int = 3, m: int = 2, *, attractor=None, speed: float = 1.0) -> SedsSkill:
    """Nothing here is stable: what a skill does is not the store's concern."""
    rng = np.random.default_rng(seed)
    return SedsSkill(
        priors=rng.dirichlet(np.full(k, 5.0)),
        means=rng.normal(size=(k, d)),
        covariances=definite(rng, k, d),
        system_matrices=rng.normal(size=(k, d, d)),
        residual_covariances=definite(rng, k, d),
        attractor=np.full(d, 0.25) if attractor is None else np.asarray(attractor),
        lyapunov=np.diag(np.arange(1.0, d + 1)),
        density=GaussianMixture(rng.dirichlet(np.full(m, 5.0)), rng.normal(size=(m, d)), definite(rng, m, d)),
        space=Euclidean.cartesian(d),
        speed=speed,
    )


def taught(seed: int, space: Space, count: int = 2) -> DemonstrationSet:
    rng = np.random.default_rng(seed)
    demonstrations = []
    for index in range(count):
        n = int(rng.integers(2, 9))
        times = np.cumsum(rng.uniform(0.01, 0.1, n))
        positions = rng.normal(size=(n, space.dimension))
        positions[:, space.positions :] *= 0.2  # rotation vectors as of motions, which do not jump
        demonstrations.append(
            Demonstration.from_positions(times, positions, f"motion-{seed}.csv#{index}", space)
        )
    return DemonstrationSet(tuple(demonstrations), space)


def reports_on(skill: Skill, sets) -> tuple[store.DemonstrationReport, ...]:
    return tuple(
        store.DemonstrationReport(
            source=d.source, leaf=leaf, n_points=d.times.size, duration=d.duration, dtw=0.125, arrived=True
        )
        for leaf, members in enumerate(sets)
        for d in members or ()
    )


RECORDED = {  # by kind of skill: the command that makes it, and what that cannot do without among its results
    SedsSkill: ("learn", {"converged": True, "notes": ("two starts agree", "the fit ran out of steps")}),
    MergedSkill: ("merge", {"lyapunov": "shared"}),
    CombinedSkill: ("combine", {"kept": (1.0, 0.5)}),
    ChainedSkill: ("chain", {}),
}


def parent(number: int, role: str) -> store.ParentRecord:
    """The record of a part."""
    digest = "1" * 64 if number == 1 else f"{number:064x}"
    return store.ParentRecord(name="reach", version=2 + number, digest=f"sha256:{digest}", role=role)


def wrapped(skill: Skill, *, without: tuple[int, ...] = ()) -> store.Artifact:
    """The artifact of a skill whose leaves keep demonstrations, except those listed."""
    sets = tuple(None if leaf in without else taught(leaf, skill.space) for leaf in range(len(skill.leaves)))
    command, results = RECORDED[type(skill)]
    role = "stage" if command == "chain" else "part"
    provenance = store.Provenance(
        inputs=(store.InputRecord(path="data/motion.csv", sha256="0" * 64, importer="csv"),),
        parents=tuple(
            parent(number, f"{role} {number}") for number in range(1, max(1, len(skill.parts)) + 1)
        ),
        tool="0.1.0",
        libraries={"numpy": "2.0.0"},
    )
    operation = store.Operation(
        command=command,
        options={"target": (0.5, 1), "align": False, "unit": "m", "note": None},
        seed=7,
        results=results,
    )
    return store.Artifact(skill, sets, operation, provenance, reports_on(skill, sets))


def bent(skill: SedsSkill, seed: int = 11, bumps: int = 5) -> SedsSkill:
    """The skill in learned coordinates: three shears."""
    rng = np.random.default_rng(seed)
    d = skill.dimension
    linear = np.triu(rng.normal(size=(d, d)), 1) + np.diag(rng.uniform(0.5, 2, d))
    numbers = (
        rng.normal(size=(3, d)),
        rng.normal(size=3),
        rng.uniform(0.1, 1, 3),
        rng.normal(size=(3, bumps, d)),
    )
    return replace(skill, coordinates=Chain((Shears(linear, *numbers),)))


def pose(seed: int, target=(0.5, -0.1, 0.4, 0.0, 3.0, -0.5), length: float = 0.25, **options) -> SedsSkill:
    """A skill of poses whose blocks are coupled: that is for the proof to find."""
    return replace(seds(seed, d=6, attractor=target, **options), space=Pose(length=length))


def bent_pose(skill: SedsSkill) -> SedsSkill:
    """The skill of poses with shears that bend positions alone."""
    (shears,) = bent(seds(11, d=3)).coordinates.links
    return replace(skill, coordinates=Chain((OnPosition(shears),)))


def skills() -> dict[str, Skill]:
    a, b, c = seds(1), seds(2, k=1, m=1, speed=0.1), seds(3, k=4)
    merged = MergedSkill((a, b), np.array([0.3, 0.7]), "density", speed=1.7)
    nested = MergedSkill((merged, c), np.array([0.1, 0.9]), "experts", parameters={"sharpness": 2.5})
    combined = CombinedSkill(
        (nested, seds(4, attractor=(3, 4))), np.array([0.5, 0.5]), "instantaneous", 0.1, 0.9
    )
    regions = (seds(6, m=2).density, seds(7, m=5).density)
    regional = CombinedSkill((a, c), np.array([0.25, 0.75]), regions=regions)
    return {
        "seds": a,
        "one component": b,
        "six dimensions": seds(5, d=6),
        "merged": merged,
        "nested merged": nested,
        "combined": CombinedSkill((a, c), np.array([0.25, 0.75])),
        "combined of merged": combined,
        "combined with regions": regional,
        "bent": bent(a),
        "bent merged": MergedSkill((bent(a), bent(b)), np.array([0.3, 0.7])),
        "pose": pose(1),
        "poses merged": MergedSkill((bent_pose(pose(1)), bent_pose(pose(2))), np.array([0.3, 0.7])),
        "poses combined": CombinedSkill(
            (bent_pose(pose(3)), pose(4, target=(0.5, 0, 0, 0, 0, -1.0))),
            np.array([0.5, 0.5]),
            regions=(pose(6).density, pose(7, m=5).density),
        ),
        "chain": ChainedSkill((a, b), np.array([1e-4, 0.1]), (("close", "wait 0.5"), ())),
        "chain of one": ChainedSkill((merged,), np.array([2.5e-3]), ((),), "back", 0.0625),
        "chain of all": ChainedSkill(
            (regional, bent(a), CombinedSkill((b, c), np.array([0.5, 0.5])), nested, regional),
            np.array([0.1, 0.2, 0.3, 0.4, 0.5]),
            (("open",), (), ("wait 0.25", "close", "beep-2"), (), ("open",)),
            "back",
        ),
        "chain of poses": ChainedSkill(
            (bent_pose(pose(1)), pose(2, target=(0.5, 0, 0, 0, 0, 1.0))), np.array([1e-4, 1e-4]), ((), ())
        ),
        "bent and plain": CombinedSkill((bent(seds(5, d=6)), seds(6, d=6)), np.array([0.25, 0.75])),
    }


SKILLS = skills()


@pytest.fixture(scope="session", params=SKILLS)
def artifact(request: pytest.FixtureRequest) -> store.Artifact:
    """An artifact of each kind in turn."""
    return wrapped(SKILLS[request.param])


@pytest.fixture(scope="session")
def wrap() -> Callable[..., store.Artifact]:
    return wrapped


@pytest.fixture(scope="session")
def make_bent() -> Callable[..., SedsSkill]:
    return bent


@pytest.fixture(scope="session")
def make_seds() -> Callable[..., SedsSkill]:
    return seds


@pytest.fixture(scope="session")
def make_pose() -> Callable[..., SedsSkill]:
    return pose


@pytest.fixture(scope="session")
def make_bent_pose() -> Callable[..., SedsSkill]:
    return lambda seed: bent_pose(pose(seed))


@pytest.fixture(scope="session")
def merged() -> MergedSkill:
    skill = SKILLS["merged"]
    assert isinstance(skill, MergedSkill)
    return skill


@pytest.fixture(scope="session")
def nested() -> store.Artifact:
    """The artifact with the most in it: a combined skill of a merged skill of a merged skill."""
    skill = SKILLS["combined of merged"]
    states = np.random.default_rng(3).normal(size=(2, 5, skill.dimension))
    golden = GoldenMotions(0.25 * np.arange(5.0), states)
    return replace(wrapped(skill, without=(1,)), golden=golden)


@pytest.fixture(scope="session")
def good(nested: store.Artifact) -> bytes:
    return store.encode(nested)


def digest_by_the_page(body: bytes, version: int = 2) -> str:
    """Compute a content digest from the specification."""
    digest = hashlib.sha256(f"skill-v{version}\n".encode())
    with h5py.File(BytesIO(b"\0" * 512 + body)) as file:
        paths = []
        file.visititems(lambda path, item: paths.append(path) if isinstance(item, h5py.Dataset) else None)
        for path in sorted(path for path in paths if not path.startswith("golden/")):
            array = file[path][()]
            shape = ",".join(str(n) for n in array.shape)
            kind = {"float64": "<f8", "int64": "<i8", "uint8": "<u1"}[str(array.dtype)]
            digest.update(f"/{path} {kind} {shape}\n".encode() + array.astype(kind).tobytes("C"))
    return f"sha256:{digest.hexdigest()}"


def sealed(
    body: bytes, kind: str = "combined", digest: str = f"sha256:{'0' * 64}", version: int = 2
) -> bytes:
    """Seal any bytes as an attacker would, from the specification."""
    lines = f"{version} {len(body)} {hashlib.sha256(body).hexdigest()}\n{kind} {digest}\n".encode()
    return (b"\x89SKILL\r\n\x1a\n" + lines).ljust(512, b"\0") + body


@pytest.fixture(scope="session")
def reseal() -> Callable[..., bytes]:
    return sealed


@pytest.fixture(scope="session")
def page_digest() -> Callable[[bytes], str]:
    return digest_by_the_page


@pytest.fixture(scope="session")
def hostile(good: bytes) -> Callable[[Callable[[h5py.File], object]], bytes]:
    """Edit the body of a good artifact with h5py, and seal it again; the seal is honest where asked for."""

    def edit_and_seal(
        edit: Callable[[h5py.File], object], *, honest: bool = False, **options: object
    ) -> bytes:
        file = BytesIO(good)
        with h5py.File(file, "r+", **options) as body:
            edit(body)
        body = file.getvalue()[512:]
        return sealed(body, digest=digest_by_the_page(body)) if honest else sealed(body)

    return edit_and_seal


@pytest.fixture(scope="session")
def with_meta(hostile) -> Callable[..., bytes]:
    """Replace meta.json by other bytes."""

    def replace(text: bytes, *, honest: bool = False) -> bytes:
        def edit(body: h5py.File) -> None:
            del body["meta.json"]
            body.create_dataset("meta.json", data=np.frombuffer(text, np.uint8), track_times=False)

        return hostile(edit, honest=honest)

    return replace


@pytest.fixture(scope="session")
def meta(good: bytes) -> dict:
    """The metadata of a good artifact."""
    with h5py.File(BytesIO(good)) as body:
        return json.loads(body["meta.json"][()].tobytes())


@pytest.fixture(scope="session")
def refuse() -> Callable[..., None]:
    """Demand that a file is refused, at once and in a sentence that can be printed."""

    def demand(data: bytes, cause: str, kind: type[ArtifactError] = errors.InvalidArtifactError) -> None:
        start = time.monotonic()
        with pytest.raises(kind, match=cause) as caught:
            store.decode(data, "hostile.h5")
        assert time.monotonic() - start < 1  # [s]
        message = str(caught.value)
        assert message.startswith("hostile.h5 ")
        assert message.isprintable()
        assert len(message) < 500
        assert caught.value.hint

    return demand


@pytest.fixture(scope="session")
def versions() -> list[bytes]:
    """Artifacts of different content."""
    return [store.encode(wrapped(seds(seed))) for seed in range(4)]
