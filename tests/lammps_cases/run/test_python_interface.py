"""The API of a notebook: laws on arrays, ASE Atoms in and out, tables of a run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import ase
import ase.build
import numpy as np
import pytest

from eos_ref import EOS, EOSTable, InputError
from lammps_cases.run import tables
from lammps_cases.scene import ase_io
from tests.support.outcome import Outcome

pytestmark = pytest.mark.lammps


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
