"""The API of a notebook: laws on arrays, ASE Atoms in and out, tables of a run."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import ase
import ase.io
import numpy as np
import pytest

import eos_ref
from eos_ref import EOS, EOSTable, InputError
from lammps_cases import audit, run
from lammps_cases.records.files import read_arrays
from lammps_cases.run import tables
from lammps_cases.scene import ase_io
from tests.support.outcome import Outcome

pytestmark = pytest.mark.lammps

DECKS = Path(__file__).parents[2] / "decks"
HALF_UNIT = 0.5e-8  # of the last digit that ASE writes
PAGE = Path(__file__).parents[3] / "docs" / "python.md"


def test_atoms_in_and_out(tmp_path: Path, eos_ref_command: Callable[..., Outcome]) -> None:
    table = EOSTable((EOS("linear", 1.2, 3.0), EOS("tait/water", 0.9, 5.0)))
    atoms = ase.Atoms("H4", positions=np.eye(4, 3))
    atoms.set_array("rho", np.array([1.0, 1.1, 1.2, 0.9]))
    atoms.set_array("type", np.array([1, 1, 1, 2]))
    expected = [float(table[t].pressure(rho)) for t, rho in zip((1, 1, 1, 2), (1.0, 1.1, 1.2, 0.9), strict=True)]
    assert ase_io.pressures(atoms, table).tolist() == expected
    with pytest.raises(InputError, match="rho"):
        ase_io.pressures(ase.Atoms("H"), table)
    eos_ref_command("run", "near-rho0.linear.3d", "--out", tmp_path / "report")
    with np.load(tmp_path / "report" / "fields" / "near-rho0.linear.3d.npz") as arrays:
        back = ase_io.as_atoms(dict(arrays))
        assert np.array_equal(back.positions, arrays["x"])
        assert np.array_equal(back.arrays["pressure_lammps"], arrays["pressure.lammps"])
        assert np.array_equal(back.arrays["type"], arrays["type"])


def test_tables(tmp_path: Path, eos_ref_command: Callable[..., Outcome]) -> None:
    eos_ref_command("run", "near-rho0", "--out", tmp_path / "report")
    frame = tables.fields(tmp_path / "report")
    pressures = frame[frame.field == "pressure"]
    assert len(pressures) == 12
    assert (pressures.max_over_bound <= 1).all()
    near = pressures.set_index("case").digits_lost_lammps
    assert near["near-rho0.tait-water.2d"] > 10, "the textbook form cancels at 1e-12 compression"
    rows = tables.particles(tmp_path / "report", "near-rho0.linear.2d")
    assert list(rows.id) == list(range(1, len(rows) + 1))
    assert (rows["pressure.lammps"] == rows["pressure.reference"]).all()


def test_tables_of_the_particle_model(tmp_path: Path, eos_ref_command: Callable[..., Outcome]) -> None:
    eos_ref_command("run", "external.gravity", "--out", tmp_path / "report")
    rows = tables.particles(tmp_path / "report", "external.gravity")
    assert {"f/x.lammps", "f/y.reference", "grad/v/yx.bound", "coordination.lammps", "v/x.lammps"} <= set(rows.columns)
    with np.load(tmp_path / "report" / "fields" / "external.gravity.npz") as arrays:
        assert np.array_equal(rows["grad/v/yx.lammps"], arrays["grad/v.lammps"][:, 1, 0])
        assert ase_io.as_atoms(dict(arrays)).arrays["f_lammps"].shape == (len(rows), 2)


def read_back(atoms: ase.Atoms, path: Path) -> ase.Atoms:
    """Write and read atoms as extended XYZ, which keeps eight digits."""
    ase.io.write(path, atoms, format="extxyz")
    return ase.io.read(path, format="extxyz")


@pytest.mark.parametrize(
    ("case", "periodic"),
    [("boundaries.fixed.drop", [False, False, True]), ("tilted.little.surface", [True] * 3)],
)
def test_atoms_of_a_run_are_complete(case: str, periodic: list[bool], tmp_path: Path) -> None:
    """Box, axes, velocities and all fields reach a file that other programs read."""
    result = run(case, jobs=1)
    arrays = read_arrays(result.folder / "fields" / f"{case}.npz")
    atoms = result.atoms()
    assert atoms.pbc.tolist() == periodic
    low_c, high_c, *tilt = arrays["box"]
    np.testing.assert_array_equal(np.diag(atoms.cell.array), high_c - low_c)
    assert atoms.cell.array[1, 0] == (tilt[0][0] if tilt else 0.0) and bool(tilt) == case.startswith("tilted")
    np.testing.assert_array_equal(atoms.info["Origin"], low_c)
    assert arrays["v"].any()
    np.testing.assert_array_equal(atoms.get_masses(), arrays["mass"])
    # times the mass and over it: two roundings
    np.testing.assert_allclose(atoms.get_velocities(), arrays["v"], rtol=2 * 2.0**-53, atol=0)
    worst = {field.field: field.worst_step for field in result.record.cases[0].fields}
    assert worst["v"] == result.record.cases[0].steps, "the case shows its last velocities"
    np.testing.assert_array_equal(arrays["v"][:, :2], arrays["v.lammps"])
    back = read_back(atoms, tmp_path / "x.extxyz")
    assert back.arrays.keys() == atoms.arrays.keys() and back.pbc.tolist() == periodic
    assert all(re.fullmatch(r"\w+", name) for name in back.arrays)
    gradient = arrays["grad/v.lammps"]
    found = back.arrays["grad_v_lammps"].reshape(gradient.shape)
    np.testing.assert_allclose(found, gradient, rtol=0, atol=HALF_UNIT + 2.0**-53)
    np.testing.assert_allclose(back.cell.array, atoms.cell.array, rtol=2.0**-53)


def test_atoms_of_an_audit(tmp_path: Path) -> None:
    atoms = audit(DECKS / "in.tilted", steps=10).atoms()
    back = read_back(atoms, tmp_path / "x.extxyz")
    assert back.cell.array[1, 0] == atoms.cell.array[1, 0] != 0
    assert back.pbc.all() and back.get_velocities().any()
    # Velocities, and momenta, which are divided by the masses.
    either_n = HALF_UNIT * (1 + 1 / back.get_masses())
    assert np.all(np.abs(back.arrays["velo"] - back.get_velocities()) <= (either_n + 4 * 2.0**-53)[:, None])
    assert {"pressure_lammps", "f_reference", "grad_v_bound"} <= set(back.arrays)


def test_atoms_of_an_earlier_version() -> None:
    """Its reports have neither axes nor velocities nor masses."""
    arrays = {
        "id": np.arange(1, 3),
        "type": np.ones(2, int),
        "x": np.eye(2, 3),
        "box": np.array([[0, 0, 0], [2, 2, 2]]),
    }
    atoms = ase_io.as_atoms(arrays)
    assert atoms.pbc.all() and not atoms.has("momenta") and atoms.cell.array.tolist() == (2 * np.eye(3)).tolist()


def test_documented_names_are_in_the_package() -> None:
    """Every name of `eos_ref.__all__` can be imported, and documents import from the package only."""
    for name in eos_ref.__all__:
        assert getattr(eos_ref, name) is not None
    assert {"ArrayEvaluator", "Box", "CompiledEvaluator", "Model", "Simulation", "State"} <= set(eos_ref.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Models'"):
        eos_ref.Models  # noqa: B018
    for page in (PAGE, PAGE.parents[1] / "README.md", PAGE.parents[1] / "eos_ref" / "NUMERICS.md"):
        for line in re.findall(r"^from eos_ref import (.*)$", page.read_text(), flags=re.MULTILINE):
            assert set(line.split(", ")) <= set(eos_ref.__all__), line
        assert not re.findall(r"^from eos_ref\.", page.read_text(), flags=re.MULTILINE)
