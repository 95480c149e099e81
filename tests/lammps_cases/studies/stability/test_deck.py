"""The deck of a cell: LAMMPS alone gives the same bits as the engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.engine.reading import read
from lammps_cases.engine.session import open_lammps, run
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.flows.catalogue import FLOWS
from lammps_cases.studies.flows.flow import Options, Start, rows, start
from lammps_cases.studies.stability.page import deck

pytestmark = pytest.mark.lammps

ARRAYS, DATA = ("x", "v", "rho"), "cell.data"


@pytest.fixture(scope="module")
def lmp() -> Any:
    return open_lammps()


def flow(name: str, n: int, steps: int, **options: Any) -> Start:
    """The first steps of a flow."""
    made = FLOWS[name].start(n, replace(FLOWS[name].options, **options))
    scene, stops = made.case.scene, (steps // 2, steps)
    assert scene.evolve
    evolve = scene.evolve.model_copy(update={"steps": steps, "compare_at": stops})
    return replace(made, case=replace(made.case, scene=scene.model_copy(update={"evolve": evolve})), steps=stops)


def disordered(**scene: Any) -> Start:
    """Particles with full-precision positions, velocities and densities, one of them on the upper face of the box."""
    rng = np.random.default_rng(5)
    x_nc = rows(0, 9, 9) + rng.uniform(-0.2, 0.2, (81, 2))
    x_nc[0] = [9.0, 0.5]
    return start(
        "disordered",
        {
            "types": [{"mass": 1.0, "rho0": 1.0, "cs": 3.0, "viscosity": 0.1}],
            "pressure": [{"types": "*", "style": "tait/water"}],
            **scene,
        },
        x_nc,
        (9.0, 9.0),
        options=Options(kernel="RK1"),
        times=[0.1, 0.3],
        timestep=0.01,
        v_nc=rng.normal(size=(81, 2)),
        rho_n=1 + 0.01 * rng.normal(size=81),
    )


def of_deck(lmp: Any, files: tuple[str, str], folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return the last arrays of LAMMPS after reading the deck from a file."""
    monkeypatch.chdir(folder)
    for name, content in zip(("in.cell", DATA), files, strict=True):
        Path(name).write_text(content)
    lmp.command("clear")
    lmp.file("in.cell")
    return read(lmp, {}, ARRAYS)


STARTS: dict[str, Callable[[], Start]] = {
    "walls, gravity, held types": lambda: flow("tank", 8, 40),
    "energies": lambda: flow("sound-wave-ideal-gas", 12, 30),
    "summed densities": lambda: flow("shear-wave", 12, 20, rho_sum=True),
    "shifting, every digit": lambda: disordered(rheo={"shift": True}),
    "a law alone": lambda: disordered(compare=("pressure",), evolve=None),
}


@pytest.mark.parametrize("name", STARTS)
def test_deck_gives_the_same_bits_as_the_engine(
    name: str, lmp: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = STARTS[name]()
    told = job(begun.case.scene, begun.atoms, plan(begun.case.scene))
    run(lmp, told)
    expected = read(lmp, told.outputs, ARRAYS)
    found = of_deck(lmp, deck(begun, DATA), tmp_path, monkeypatch)
    assert found["id"].tolist() == expected["id"].tolist()
    for array in ARRAYS:
        assert found[array].tobytes() == expected[array].tobytes(), array


def test_output_has_full_precision(lmp: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun = disordered()
    found = of_deck(lmp, deck(begun, DATA, every=5), tmp_path, monkeypatch)
    lmp.command("undump frames")  # so that LAMMPS closes the file
    header, _, table = Path("frames.dump").read_text().rpartition("ITEM: ATOMS")[2].partition("\n")
    assert header.split() == ["id", "type", "x", "y", "z", "vx", "vy", "vz", "rho", "pressure"]
    values = np.array([line.split() for line in table.splitlines()], float)
    assert np.array_equal(values[:, 2:5], found["x"])
    assert np.array_equal(values[:, 8], found["rho"])


def test_notes_are_comments(lmp: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notes = ["ends in &", 'quotes """', "it's 'quoted'", "two\nquit", "${HOME} $(1/0)", "naïve"]
    assert len(of_deck(lmp, deck(disordered(), DATA, notes), tmp_path, monkeypatch)["id"]) == 81


@pytest.mark.parametrize(
    ("array", "change", "said"),
    [
        ("rho_n", lambda rho_n: np.where(np.arange(81) == 3, np.nan, rho_n), "rho: must be finite in a deck"),
        ("rho_n", lambda rho_n: np.where(np.arange(81) == 3, np.inf, rho_n), "rho: must be finite in a deck"),
    ],
)
def test_input_that_lammps_cannot_read_is_refused(array: str, change: Callable[[Any], Any], said: str) -> None:
    begun = disordered()
    atoms = replace(begun.atoms, **{array: change(getattr(begun.atoms, array))})
    with pytest.raises(InputError, match=said):
        deck(replace(begun, atoms=atoms), DATA)
