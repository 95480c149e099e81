"""Faults in LAMMPS' input that no scene can say: a fix dropped, an atom moved, numbers rounded on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from lammps_cases.engine.session import Job
from lammps_cases.studies.mutation.fault import Kind
from lammps_cases.studies.mutation.input_faults import InputFault, JobChange, replaced_text, without


def _setup(change: Callable[[str], str]) -> JobChange:
    return lambda of: replace(of, setup=tuple(change(line) for line in of.setup))


def _commands(change: Callable[[str], str]) -> JobChange:
    return lambda of: replace(of, commands=tuple(change(line) for line in of.commands))


def _last(begins: str) -> JobChange:
    """Move commands that begin so behind all others."""

    def change_job(of: Job) -> Job:
        moved = tuple(line for line in of.commands if line.startswith(begins))
        return replace(of, commands=(*(line for line in of.commands if line not in moved), *moved))

    return change_job


def _neighbours(*settings: str) -> JobChange:
    """Set other settings of neighbour lists."""
    words = {line.split()[0]: line for line in settings}

    def change_job(of: Job) -> Job:
        if not any(line.startswith("pair_style") for line in of.commands):
            return of
        kept = [line for line in of.setup if line.split()[0] not in words or "binsize" in line]
        at = next(k for k, line in enumerate(kept) if line.startswith("region"))
        return replace(of, setup=(*kept[:at], *settings, *kept[at:]))

    return change_job


def _pair_cut(factor: float) -> JobChange:
    def change(line: str) -> str:
        if not line.startswith("pair_style rheo"):
            return line
        words = line.split()
        return " ".join([*words[:2], repr(float(words[2]) * factor), *words[3:]])

    return _commands(change)


def _box(change: Callable[[float], float]) -> JobChange:
    """Move the upper end of the box along x."""

    def of(line: str) -> str:
        if not line.startswith("region box"):
            return line
        words = line.split()
        return " ".join([*words[:4], repr(change(float(words[4]))), *words[5:]])

    return _setup(of)


def _array(name: str, change: Callable[[Any], Any]) -> JobChange:
    """Change positions (x), velocities (v), types, or a value per atom (rho, esph) that LAMMPS is given."""

    def change_job(of: Job) -> Job:
        if name in ("x", "v", "type"):
            field = {"x": "x_nc", "v": "v_nc", "type": "type_n"}[name]
            given = getattr(of, field)
            return of if given is None else replace(of, **{field: change(given.copy())})
        if name not in of.per_atom:
            return of
        return replace(of, per_atom={**of.per_atom, name: change(of.per_atom[name].copy())})

    return change_job


def _one(by: float) -> Callable[[Any], Any]:
    """Change one atom's value by a relative amount, of a vector its largest component."""

    def change(array_n: Any) -> Any:
        row = array_n[len(array_n) // 2]
        if row.ndim:
            row[np.abs(row).argmax()] *= 1 + by
        else:
            array_n[len(array_n) // 2] *= 1 + by
        return array_n

    return change


def _exchange(array_n: Any) -> Any:
    array_n[[0, -1]] = array_n[[-1, 0]]
    return array_n


def _single(array_n: Any) -> Any:
    return array_n.astype(np.float32).astype(float)


def _fewer(of: Job) -> Job:
    """Without the last atom."""
    per_atom = {name: values[:-1] for name, values in of.per_atom.items()}
    v_nc = None if of.v_nc is None else of.v_nc[:-1]
    return replace(of, id_n=of.id_n[:-1], type_n=of.type_n[:-1], x_nc=of.x_nc[:-1], v_nc=v_nc, per_atom=per_atom)


def _renamed(of: Job) -> Job:
    """Ids of two atoms of different rows exchanged: their places and values are each other's."""
    per_atom = {name: _exchange(values.copy()) for name, values in of.per_atom.items()}
    v_nc = None if of.v_nc is None else _exchange(of.v_nc.copy())
    x_nc, type_n = _exchange(of.x_nc.copy()), _exchange(of.type_n.copy())
    return replace(of, type_n=type_n, x_nc=x_nc, v_nc=v_nc, per_atom=per_atom)


def _energy_per_mass(of: Job) -> Job:
    """Energies as if the scene's were those of particles, not per mass."""
    if "esph" not in of.per_atom:
        return of
    masses = {int(line.split()[1]): float(line.split()[2]) for line in of.commands if line.startswith("mass ")}
    mass_n = np.array([masses[int(t)] for t in of.type_n])
    return replace(of, per_atom={**of.per_atom, "esph": of.per_atom["esph"] / mass_n})


def _without_array(name: str) -> JobChange:
    def change_job(of: Job) -> Job:
        return replace(of, per_atom={k: v for k, v in of.per_atom.items() if k != name})

    return change_job


def _exclude_pairs(of: Job) -> Job:
    """Pairs of types 1 and 2 left out of the neighbour lists."""
    if not any(line.startswith("pair_style") for line in of.commands) or of.type_n.max() < 2:
        return of
    return replace(of, commands=("neigh_modify exclude type 1 2", *of.commands))


def _first_run_again(of: Job) -> Job:
    """Set every run up anew, where it should be continued."""
    return replace(of, runs=tuple(replace(run, command=run.command.replace(" pre no", "")) for run in of.runs))


_TABLE: tuple[tuple[str, Kind, str, JobChange], ...] = (
    # --- commands
    ("no-viscosity-fix", "missing term", "fix rheo/viscosity left out", without("fix viscosity")),
    ("no-pressure-fix", "missing term", "fix rheo/pressure left out", without("fix pressure")),
    ("no-thermal-fix", "missing term", "fix rheo/thermal left out", without("fix thermal")),
    ("no-pair-style", "missing term", "pair_style rheo left out", without("pair_style", "pair_coeff")),
    ("no-status", "unset", "phase of solids never set", without("set type")),
    ("no-timestep", "unset", "time step never set", without("timestep")),
    ("no-masses", "unset", "masses never set", without("mass")),
    ("rheo-last", "order of operations", "fix rheo behind the other fixes", _last("fix rheo ")),
    ("pair-cut-smaller", "neighbours", "cutoff of pair_style rheo 10 % smaller", _pair_cut(0.9)),
    ("dimension-3", "constant", "dimension 3 in place of 2", replaced_text("dimension 2", "dimension 3")),
    ("not-periodic", "neighbours", "periodic axes told to be fixed", replaced_text("boundary p", "boundary f")),
    ("box-longer", "neighbours", "box longer by 1e-6", _box(lambda high: high * (1 + 1e-6))),
    ("box-twice", "neighbours", "box twice as long", _box(lambda high: high * 2)),
    (
        "lists-never-rebuilt",
        "stale",
        "neighbour lists never built anew, with hardly any skin",
        _neighbours("neighbor 1e-9 bin", "neigh_modify every 10000 delay 10000 check no"),
    ),
    (
        "lists-rebuilt-seldom",
        "stale",
        "neighbour lists built every 8 steps, with hardly any skin",
        _neighbours("neighbor 1e-9 bin", "neigh_modify every 8 delay 8 check no"),
    ),
    ("pairs-left-out", "neighbours", "pairs of different types left out of the lists", _exclude_pairs),
    ("velocities-of-images", "stale", "velocities of periodic images not communicated", without("comm_modify")),
    ("set-up-again", "order of operations", "every run set up anew where it goes on", _first_run_again),
    # --- what atoms are given
    ("atom-lost", "missing term", "last atom not created", _fewer),
    ("atoms-renamed", "exchanged", "two atoms with each other's place and values", _renamed),
    ("types-exchanged", "exchanged", "two atoms with each other's type", _array("type", _exchange)),
    (
        "type-of-one",
        "type range",
        "an atom of type 1 where it is of the last",
        _array("type", lambda t: np.r_[1, t[1:]]),
    ),
    ("all-of-type-1", "type range", "all atoms of type 1", _array("type", np.ones_like)),
    ("x-single", "single precision", "positions rounded to float32", _array("x", _single)),
    ("v-single", "single precision", "velocities rounded to float32", _array("v", _single)),
    ("rho-single", "single precision", "densities rounded to float32", _array("rho", _single)),
    ("energy-single", "single precision", "energies rounded to float32", _array("esph", _single)),
    ("x-of-one", "last digits", "position of one atom off by 1e-9", _array("x", _one(1e-9))),
    ("v-of-one", "last digits", "velocity of one atom off by 1e-9", _array("v", _one(1e-9))),
    ("rho-of-one", "last digits", "density of one atom off by 1e-12", _array("rho", _one(1e-12))),
    ("energy-of-one", "last digits", "energy of one atom off by 1e-12", _array("esph", _one(1e-12))),
    ("x-exchanged", "exchanged", "two atoms with each other's position", _array("x", _exchange)),
    ("rho-exchanged", "exchanged", "two atoms with each other's density", _array("rho", _exchange)),
    ("v-sign", "sign", "velocities of the other sign", _array("v", lambda v: -v)),
    ("v-axes", "exchanged", "components x and y of velocities exchanged", _array("v", lambda v: v[:, [1, 0, 2]])),
    ("v-zero", "unset", "velocities never set", _array("v", np.zeros_like)),
    ("rho-unset", "unset", "densities never set", _without_array("rho")),
    ("energy-unset", "unset", "energies never set", _without_array("esph")),
    ("energy-not-per-mass", "volume or mass", "energies per mass where those of particles belong", _energy_per_mass),
    ("energy-doubled", "constant", "energies doubled", _array("esph", lambda e: 2 * e)),
)
FAULTS = tuple(InputFault(f"told.{name}", kind, what, None, change) for name, kind, what, change in _TABLE)
