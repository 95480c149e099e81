"""Faults in the input of real LAMMPS: it differs from the scene that judges the answer.

A change of the scene goes through `lammps_cases.setup.commands` as any other scene; what no scene can express (a fix
dropped, an atom moved) is changed in the job itself. A change without effect on a job does not apply to its case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np

from eos_ref import InputError
from lammps_cases.engine.interlude import Interlude, InterludeAction
from lammps_cases.engine.session import Job, RunCommand
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.changes import Kind
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from tests.workshop.faults import scene_faults
from tests.workshop.faults.fault import by_id
from tests.workshop.faults.output_faults import ends_exchanged, middle, single
from tests.workshop.faults.perturbed import rearranged
from tests.workshop.faults.scene_faults import InputFault, JobChange


def jobs(fault: InputFault, ready: PreparedCase, lists: bool = False) -> list[Job] | None:
    """Return the jobs of a case, or of both runs of a twin, with a fault; None if it does not apply.

    With ``lists`` those that read every step and the neighbour lists.
    """
    right_jobs, faulty = ready.reading_lists if lists else ready.jobs, []
    for (scene, atoms), right in zip(ready.sides, right_jobs, strict=True):
        wrong = right
        if fault.change_scene is not None:
            try:
                changed = fault.change_scene(scene)
                wrong = _job(changed, atoms, scene, lists) if changed != scene else right
            except (InputError, ValueError, IndexError, ZeroDivisionError, OverflowError):
                return None  # the change makes no sense for this scene
        if fault.change_job is not None:
            wrong = fault.change_job(wrong)
        faulty.append(wrong)
    same = [_same(one, other) for one, other in zip(faulty, right_jobs, strict=True)]
    return None if all(same) else faulty


def _job(changed: Scene, atoms: Atoms, scene: Scene, lists: bool) -> Job:
    """Return the job of a changed scene; it may request missing fields, which LAMMPS has to refuse."""
    try:
        items = plan(changed)
    except InputError:
        items = plan(scene)
    return job(changed, atoms, items, every_step=lists, lists=lists)


def _same(one: Job, other: Job) -> bool:
    def equal(a: Any, b: Any) -> bool:
        return np.array_equal(a, b) if isinstance(a, np.ndarray) or isinstance(b, np.ndarray) else bool(a == b)

    per_atom = [(one.per_atom.get(name), other.per_atom.get(name)) for name in {*one.per_atom, *other.per_atom}]
    others = [(getattr(one, f.name), getattr(other, f.name)) for f in fields(Job) if f.name != "per_atom"]
    return all(equal(a, b) for a, b in (*others, *per_atom))


# --- what no scene can express


def _lines(change: Callable[[str], str]) -> JobChange:
    """Change every line of the commands."""
    return lambda of: replace(of, setup=tuple(map(change, of.setup)), commands=tuple(map(change, of.commands)))


def _replaced(old: str, new: str) -> JobChange:
    """Replace text in all commands."""
    return _lines(lambda line: line.replace(old, new))


def _number(begins: str, at: int, change: Callable[[float], float]) -> JobChange:
    """Change the word of index ``at``, a number, in commands with this beginning."""

    def change_line(line: str) -> str:
        words = line.split()
        return " ".join([*words[:at], repr(change(float(words[at]))), *words[at + 1 :]])

    return _lines(lambda line: change_line(line) if line.startswith(begins) else line)


def _without(*beginnings: str) -> JobChange:
    """Leave out commands with these beginnings."""

    def kept(lines: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(line for line in lines if not line.startswith(beginnings))

    return lambda of: replace(of, setup=kept(of.setup), commands=kept(of.commands))


def _last(begins: str) -> JobChange:
    """Move commands with this beginning after all others."""
    return lambda of: replace(of, commands=tuple(sorted(of.commands, key=lambda line: line.startswith(begins))))


def _seldom(steps: int) -> JobChange:
    """Rebuild neighbour lists every so many steps, with hardly any skin."""

    def change_job(of: Job) -> Job:
        if not any(line.startswith("pair_style") for line in of.commands):
            return of
        kept = [line for line in of.setup if line.split()[0] not in ("neighbor", "neigh_modify") or "binsize" in line]
        at = next(k for k, line in enumerate(kept) if line.startswith("region"))
        settings = "neighbor 1e-9 bin", f"neigh_modify every {steps} delay {steps} check no"
        return replace(of, setup=(*kept[:at], *settings, *kept[at:]))

    return change_job


Actions = tuple[InterludeAction, ...]
_FIELDS = {"x": "x_nc", "v": "v_nc", "type": "type_n"}


def _array(name: str, change: Callable[[Any], Any]) -> JobChange:
    """Change positions (x), velocities (v), types, or a value per atom (rho, esph) that LAMMPS is given."""

    def change_job(of: Job) -> Job:
        given = getattr(of, _FIELDS[name]) if name in _FIELDS else of.per_atom.get(name)
        if given is None:
            return of
        changed = change(given.copy())
        return replace(
            of, **({_FIELDS[name]: changed} if name in _FIELDS else {"per_atom": {**of.per_atom, name: changed}})
        )

    return change_job


def _one(by: float) -> Callable[[Any], Any]:
    """Change the middle atom's value by a relative amount, of a vector its largest component."""

    def change(value: Any) -> Any:
        value_c = np.array(value)
        value_c.reshape(-1)[np.abs(value_c).argmax()] *= 1 + by
        return value_c

    return middle(change)


def _fewer(of: Job) -> Job:
    """Leave out the last atom."""
    return rearranged(of, np.arange(len(of.id_n) - 1))


def _exchange_atoms(of: Job) -> Job:
    """Exchange positions and values of the first and the last atom, but not ids."""
    row_n = ends_exchanged(np.arange(len(of.id_n)))
    return rearranged(of, row_n, of.id_n)


def _energy_per_mass(of: Job) -> Job:
    """Divide energies by the masses, as if the scene gave energies per particle."""
    masses = {int(line.split()[1]): float(line.split()[2]) for line in of.commands if line.startswith("mass ")}
    return _array("esph", lambda e_n: e_n / np.array([masses[int(t)] for t in of.type_n]))(of)


def _without_array(name: str) -> JobChange:
    return lambda of: replace(of, per_atom={k: v for k, v in of.per_atom.items() if k != name})


def _exclude_pairs(of: Job) -> Job:
    """Leave pairs of types 1 and 2 out of the neighbour lists."""
    if not any(line.startswith("pair_style") for line in of.commands) or of.type_n.max() < 2:
        return of
    return replace(of, commands=("neigh_modify exclude type 1 2", *of.commands))


def _newton_apart(of: Job) -> Job:
    """Set newton off for pairs and on for bonds, so that LAMMPS adds the sums of images to their particles."""
    setup = [line for line in of.setup if not line.startswith("newton ")]
    at = next(k for k, line in enumerate(setup) if line.startswith("atom_style")) + 1
    return replace(of, setup=(*setup[:at], "newton off on", *setup[at:]))


def _commands_of_runs(old: str, new: str) -> JobChange:
    """Replace text in the run commands."""

    def change(stretch: RunCommand | Interlude) -> RunCommand | Interlude:
        runs = isinstance(stretch, RunCommand)
        return replace(stretch, command=stretch.command.replace(old, new)) if runs else stretch

    return lambda of: replace(of, runs=tuple(map(change, of.runs)))


def _between(change: Callable[[Actions], Iterable[InterludeAction]]) -> JobChange:
    """Change what is done between runs."""

    def changed(stretch: RunCommand | Interlude) -> RunCommand | Interlude:
        between = isinstance(stretch, Interlude)
        return replace(stretch, actions=tuple(change(stretch.actions))) if between else stretch

    return lambda of: replace(of, runs=tuple(map(changed, of.runs)))


def _added(before: str, *commands: str) -> JobChange:
    """Add commands between runs, before those that begin with ``before``; at the end if that is empty."""

    def change(actions: Actions) -> Actions:
        places = [k for k, action in enumerate(actions) if action.text.startswith(before)] if before else [len(actions)]
        further = map(InterludeAction, commands)
        return (*actions[: places[0]], *further, *actions[places[0] :]) if places else actions

    return _between(change)


def _not_between(*beginnings: str) -> JobChange:
    """Leave out commands between runs with these beginnings."""
    return _between(lambda actions: (action for action in actions if not action.text.startswith(beginnings)))


def _between_without(words: str) -> JobChange:
    """Leave out words of the commands between runs."""
    return _between(lambda actions: (replace(action, text=action.text.replace(words, "")) for action in actions))


def _never_again(of: Job) -> Job:
    """Continue where a run should start with its own set-up."""
    first, *others = of.runs
    if not any(isinstance(stretch, Interlude) for stretch in others):
        return of
    changed = _commands_of_runs("run 0 post", "run 0 pre no post")
    return replace(of, runs=(first, *changed(replace(of, runs=tuple(others))).runs))


def _without_interludes(of: Job) -> Job:
    """Do nothing between runs."""
    return replace(of, runs=tuple(s for s in of.runs if not isinstance(s, Interlude)))


_TABLE: tuple[tuple[str, Kind, str, JobChange], ...] = (
    # --- commands
    ("no-viscosity-fix", "missing term", "fix rheo/viscosity left out", _without("fix viscosity")),
    ("no-pressure-fix", "missing term", "fix rheo/pressure left out", _without("fix pressure")),
    ("no-thermal-fix", "missing term", "fix rheo/thermal left out", _without("fix thermal")),
    ("no-pair-style", "missing term", "pair_style rheo left out", _without("pair_style", "pair_coeff")),
    ("no-status", "unset", "phase of solids never set", _without("set type")),
    ("no-timestep", "unset", "time step never set", _without("timestep")),
    ("no-masses", "unset", "masses never set", _without("mass")),
    ("rheo-last", "order of operations", "fix rheo behind the other fixes", _last("fix rheo ")),
    (
        "pair-cut-smaller",
        "neighbours",
        "cutoff of pairs 10 % smaller",
        _number("pair_style rheo", 2, lambda cut: cut * 0.9),
    ),
    ("dimension-3", "constant", "dimension 3 in place of 2", _replaced("dimension 2", "dimension 3")),
    ("not-periodic", "neighbours", "periodic axes made fixed", _replaced("boundary p", "boundary f")),
    ("box-longer", "neighbours", "box longer by 1e-6", _number("region box", 4, lambda high: high * (1 + 1e-6))),
    ("box-twice", "neighbours", "box twice as long", _number("region box", 4, lambda high: high * 2)),
    ("lists-never-rebuilt", "stale", "neighbour lists never rebuilt", _seldom(10000)),
    ("lists-rebuilt-seldom", "stale", "neighbour lists built every 8 steps", _seldom(8)),
    ("pairs-left-out", "neighbours", "pairs of different types left out of the lists", _exclude_pairs),
    ("velocities-of-images", "stale", "velocities of periodic images not communicated", _without("comm_modify")),
    ("images-collect-twice", "neighbours", "pairs across boundaries counted twice in some sums", _newton_apart),
    ("set-up-again", "order of operations", "every run set up again where continued", _commands_of_runs(" pre no", "")),
    ("no-deform", "missing term", "fix deform left out", _without("fix deform")),
    ("deform-alone", "missing term", "positions not changed with a box that grows", _replaced("remap x", "remap none")),
    ("deform-with-x", "missing term", "positions changed with it", _replaced("remap none", "remap x")),
    ("images-at-rest", "missing term", "images that do not move with the box", _replaced("remap v", "remap none")),
    ("deform-later", "stale", "the box growing in every second step", _replaced(" deform 1 ", " deform 2 ")),
    # --- between runs
    ("set-up-never-again", "stale", "runs continued where they should be set up again", _never_again),
    ("nothing-between", "missing term", "nothing done between runs", _without_interludes),
    ("restart-loses-rho", "unset", "densities 1 after a file", _added("pair_style", "set group all rheo/rho 1.0")),
    ("restart-loses-status", "unset", "all fluid after a file", _added("pair_style", "set group all rheo/status 0")),
    ("restart-loses-energy", "unset", "energies 1 after a file", _added("pair_style", "set group all sph/e 1.0")),
    (
        *("restart-loses-v", "unset", "velocities 0 after a file is read"),
        _added("pair_style", "set group all vx 0.0 vy 0.0 vz 0.0"),
    ),
    (
        *("restart-moves-one", "last digits", "one atom moved by 1e-9 between runs"),
        _added("", "group moved id 3", "displace_atoms moved move 1e-9 0 0 units box"),
    ),
    ("between-no-timestep", "unset", "time step not set between runs", _not_between("timestep")),
    ("between-no-reset", "unset", "fix dt/reset left out", _not_between("fix reset")),
    ("between-no-forces", "missing term", "forces of other fixes not defined again", _not_between("fix force")),
    ("between-no-displacement", "missing term", "atoms not displaced", _not_between("displace_atoms")),
    ("between-no-stretch", "missing term", "the box as it was", _not_between("change_box")),
    ("stretch-without-atoms", "missing term", "positions not changed with the box", _between_without(" remap")),
    ("between-no-velocities", "unset", "velocities of recreated atoms not set", _not_between("set atom")),
    ("between-no-count", "unset", "steps counted on where the count is set", _not_between("reset_timestep")),
    # --- what atoms are given
    ("atom-lost", "missing term", "last atom not created", _fewer),
    ("atoms-renamed", "exchanged", "two atoms with each other's place and values", _exchange_atoms),
    ("types-exchanged", "exchanged", "two atoms with each other's type", _array("type", ends_exchanged)),
    ("type-of-one", "type range", "an atom of type 1", _array("type", lambda t: np.r_[1, t[1:]])),
    ("all-of-type-1", "type range", "all atoms of type 1", _array("type", np.ones_like)),
    ("x-single", "single precision", "positions rounded to float32", _array("x", single)),
    ("v-single", "single precision", "velocities rounded to float32", _array("v", single)),
    ("rho-single", "single precision", "densities rounded to float32", _array("rho", single)),
    ("energy-single", "single precision", "energies rounded to float32", _array("esph", single)),
    ("x-of-one", "last digits", "position of one atom off by 1e-9", _array("x", _one(1e-9))),
    ("v-of-one", "last digits", "velocity of one atom off by 1e-9", _array("v", _one(1e-9))),
    ("rho-of-one", "last digits", "density of one atom off by 1e-12", _array("rho", _one(1e-12))),
    ("energy-of-one", "last digits", "energy of one atom off by 1e-12", _array("esph", _one(1e-12))),
    ("x-exchanged", "exchanged", "two atoms with each other's position", _array("x", ends_exchanged)),
    ("rho-exchanged", "exchanged", "two atoms with each other's density", _array("rho", ends_exchanged)),
    ("v-sign", "sign", "velocities of the other sign", _array("v", lambda v: -v)),
    ("v-axes", "exchanged", "components x and y of velocities exchanged", _array("v", lambda v: v[:, [1, 0, 2]])),
    ("v-zero", "unset", "velocities never set", _array("v", np.zeros_like)),
    ("rho-unset", "unset", "densities never set", _without_array("rho")),
    ("energy-unset", "unset", "energies never set", _without_array("esph")),
    ("energy-not-per-mass", "volume or mass", "energies per mass where those of particles belong", _energy_per_mass),
    ("energy-doubled", "constant", "energies doubled", _array("esph", lambda e: 2 * e)),
)


@cache
def faults() -> dict[str, InputFault]:
    """Return all faults of this family by their id, in order."""
    of_jobs = (InputFault(f"told.{name}", kind, what, None, change) for name, kind, what, change in _TABLE)
    return by_id((*scene_faults.FAULTS, *of_jobs))
