"""Hypotheses about equations of state: a change may be meaningful for only some scenes of a group."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lammps_cases.records.case_parts import Blame
from lammps_cases.records.files import write_arrays
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict.diagnosis import laws

ONE = {"mass": 1.3, "rho0": 1.2, "cs": 3.1}
LINEAR, GAS = {"types": "*", "style": "linear"}, {"types": "*", "style": "ideal/gas", "gamma": 1.4}


def red(case: Case, folder: Path) -> CaseRecord:
    """Return a case in which all pressures are twice the correct ones; energies are not saved."""
    atoms = prepare(case).atoms
    p_n = case.scene.eos(case.where).pressure(atoms.rho_n, atoms.type_n, np.ones_like(atoms.rho_n))
    arrays = {"id": atoms.id_n, "type": atoms.type_n, "rho": atoms.rho_n, "mass": atoms.mass_n}
    arrays |= {"pressure.lammps": 2 * p_n, "pressure.bound": 1e-14 * abs(p_n)}
    write_arrays(folder / f"{case.name}.npz", arrays)
    blame = Blame(field="pressure", stage="eos", atom=1, outside=1, of=1, lammps=2.0, reference=1.0, bound=1e-14)
    return CaseRecord(case=case.name, verdict="differs", blame=blame)


@pytest.mark.parametrize(("law", "energy", "reproduced"), [(LINEAR, None, {"three", "one"}), (GAS, 1.0, {"three"})])
def test_change_is_not_tried_on_scenes_where_it_is_meaningless(
    law: dict[str, Any], energy: float | None, reproduced: set[str], tmp_path: Path, case_file: Callable[..., Path]
) -> None:
    """A scene of one type next to one of three; an ideal gas whose energies are not available."""
    one = {"types": [ONE], "pressure": [law], "energy": energy and {"constant": energy}}
    files = case_file("three", types=[ONE, ONE, ONE], pressure=[LINEAR]), case_file("one", **one)
    cases = {case.name: case for file in files for case in casefile.load_file(file)}
    tried, found = laws.hypotheses([red(case, tmp_path) for case in cases.values()], cases, tmp_path)
    assert tried > 40 and found.cases == reproduced
    assert "the pressure of every particle were twice as large" in found.sentences
