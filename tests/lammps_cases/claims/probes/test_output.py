"""Columns of compute rheo/property/atom: each input alone, by component, in any order, twice, before and after runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lammps_cases.engine.session import RunCommand
from lammps_cases.scene.fields import FIELDS
from tests.support.small_scene import Engine, SmallScene, agree, engine, small_scene

pytestmark = pytest.mark.lammps

COLUMNS = [name for name, field in FIELDS.items() if field.column == name]
DIMENSIONS = [2, 3]
KNOWN = ("force-per-volume", "heat-is-temperature-rate")
CRASHES = "stress/t"  # without pressure, see the finding stress-without-pressure-segfault
RUNS = (RunCommand("run 0 post no"), RunCommand("run 2 pre no post no"), RunCommand("run 1 post no"))


@pytest.fixture(scope="module")
def lammps() -> Iterator[Engine]:
    """The LAMMPS of this environment."""
    with engine() as opened:
        yield opened


def everything(dimension: int) -> SmallScene:
    """A scene that has every column: fluid over solids at rest with a surface, shift and heat."""
    random = np.random.default_rng(dimension)
    axis = [np.arange(n) + 0.5 for n in ((6, 5) if dimension == 2 else (4, 4, 4))]
    grid = np.stack(np.meshgrid(*axis, indexing="ij"), axis=-1).reshape(-1, dimension)
    x = grid + random.uniform(-0.1, 0.1, grid.shape)
    kind = np.where(grid[:, -1] < 1.0, 2, 1)
    v = np.where(kind[:, None] == 2, 0.0, random.uniform(-0.3, 0.3, grid.shape))
    types = [
        {"mass": 1.31, "viscosity": 0.17, "conductivity": 0.7, "specific_heat": 1.5},
        {"mass": 0.62, "viscosity": 0.29, "conductivity": 0.3, "specific_heat": 0.8, "phase": "solid"},
    ]
    return small_scene(
        x,
        (6, 8) if dimension == 2 else (4, 4, 8),
        v=v,
        rho=random.uniform(0.95, 1.05, len(x)),
        e=random.uniform(1.0, 2.0, len(x)),
        kind=kind,
        types=types,
        rheo={
            "cut": 2.0,
            "shift": True,
            "interface_reconstruct": True,
            "surface_detection": {"style": "coordination", "limit": 10 if dimension == 2 else 26, "splash": 2},
        },
        forces=[{"style": "setforce", "types": 2, "vector": [0.0] * dimension}],
        compare=COLUMNS,
    )


def components(name: str, dimension: int) -> list[str]:
    """The columns of an input by name."""
    axes = "xyz"[:dimension]
    inner = {0: [""], 1: [f"/{a}" for a in axes], 2: [f"/{a}{b}" for a in axes for b in axes]}
    return [name + end for end in inner[FIELDS[name].quantity.rank]]


def shown(lammps: Engine, scene: SmallScene, words: Sequence[str]) -> list[Any]:
    """The columns (n, words) that LAMMPS outputs for some inputs, after the set-up and after each run."""
    kept = [line for line in scene.job.commands if not line.startswith("compute q ")]
    asked = (*kept, "timestep 0.004", f"compute q all rheo/property/atom {' '.join(words)}")
    named = {f"{k}": () for k in range(len(words))}  # LAMMPS' columns have no names
    answer = lammps.answer(replace(scene.job, commands=asked, runs=RUNS, outputs=named))
    return [np.column_stack([at[f"q.{k}"] for k in named]) for at in answer.snapshots]


def every(dimension: int) -> list[str]:
    """All columns by name."""
    return [word for name in COLUMNS for word in components(name, dimension)]


@pytest.fixture(scope="module", params=DIMENSIONS)
def whole(request: pytest.FixtureRequest, lammps: Engine) -> tuple[SmallScene, list[Any]]:
    """A scene, and all its columns in the order of the table."""
    scene = everything(request.param)
    return scene, shown(lammps, scene, every(request.param))


def place(scene: SmallScene, words: Sequence[str]) -> list[int]:
    """The indices of some columns among all."""
    order = every(scene.scene.dimension)
    return [order.index(word) for word in words]


def same(scene: SmallScene, whole: list[Any], words: Sequence[str], found: list[Any]) -> bool:
    """Whether columns equal the same columns of the full output, to the last bit."""
    return all(np.array_equal(at[:, place(scene, words)], ours) for at, ours in zip(whole, found, strict=True))


def test_named_components_are_those_of_the_reference(whole: tuple[SmallScene, list[Any]]) -> None:
    """Before the first step, where every column is predicted; columns that must differ are not equal."""
    scene, at = whole
    prediction, d = scene.predicted(*KNOWN), scene.scene.dimension
    for name in set(COLUMNS) - {"status"}:  # its bits are not documented
        found = at[0][:, place(scene, components(name, d))]
        assert agree(found.reshape(prediction.fields[0][name].shape), prediction, name), name
    words = [word for name in ("grad/v", "shift/v", "surface/n") for word in components(name, d)]
    assert len({column.tobytes() for column in at[0][:, place(scene, words)].T}) == len(words)


def test_every_input_alone(lammps: Engine, whole: tuple[SmallScene, list[Any]]) -> None:
    scene, at = whole
    for word in every(scene.scene.dimension):
        words = [word, "pressure"] if word.startswith(CRASHES) else [word]
        assert same(scene, at, words, shown(lammps, scene, words)), word


@pytest.mark.parametrize("seed", range(4))
def test_any_order_and_repetition(lammps: Engine, whole: tuple[SmallScene, list[Any]], seed: int) -> None:
    """A permutation in which some columns come twice."""
    scene, at = whole
    random = np.random.default_rng(seed)
    words = random.permutation(every(scene.scene.dimension)).tolist()
    words += random.choice(words, 5).tolist()
    assert same(scene, at, words, shown(lammps, scene, words))


def test_stars_expand_in_the_order_of_the_manual(lammps: Engine, whole: tuple[SmallScene, list[Any]]) -> None:
    """xx, xy, (xz,) yx, ...; the deck of the harness relies on this order."""
    scene, at = whole
    answer = lammps.answer(scene.job)
    found = np.column_stack([answer.snapshots[0][f"q.{name}"].reshape(len(at[0]), -1) for name in COLUMNS])
    assert np.array_equal(found, at[0])


def test_exchanged_column_is_detected(whole: tuple[SmallScene, list[Any]]) -> None:
    scene, at = whole
    words = ["grad/v/xy", "grad/v/yx"]
    exchanged = [array[:, place(scene, words[::-1])] for array in at]
    assert not same(scene, at, words, exchanged)


@pytest.mark.parametrize(
    "word", ["shift/v/z", "grad/v/xz", "surface/n/z", "stress/v/zz", "grad/v/x", "surface/n", "grad/v/XY", "Pressure"]
)
def test_unknown_column_is_refused(lammps: Engine, word: str) -> None:
    """In 2D, also a third axis."""
    with pytest.raises(AssertionError, match=r"verdict='refused'.*property"):
        shown(lammps, everything(2), [word])
