"""The calculators: the reference and LAMMPS agree for an ase.Atoms, apart from named findings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

import ase
import numpy as np
import pytest
from ase.calculators.calculator import CalculationFailed
from ase.md.verlet import VelocityVerlet

from eos_ref import EosRefCalculator, InputError, LammpsRheoCalculator, run
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.run.calculators import RheoCalculator, particles, scene_of
from lammps_cases.run.command import Result
from lammps_cases.scene import Scene, casefile
from lammps_cases.setup import reference_side

pytestmark = pytest.mark.lammps

# Cases with the findings that these results of them show on the engine of this environment.
SHOWN = {
    "external.gravity": ["force-per-volume"],
    "forces.power.quintic.3d": ["force-per-volume"],
    "tilted.little.fluid": ["force-per-volume"],
}
RESULTS = ("forces", "pressure", "density")


@cache
def scene_of_case(name: str) -> Scene:
    return {case.name: case.scene for case in casefile.load()}[name]


@pytest.fixture(scope="module")
def ran() -> Result:
    return run(list(SHOWN), jobs=1)


@contextmanager
def lammps(settings: object) -> Iterator[LammpsRheoCalculator]:
    calculator = LammpsRheoCalculator(settings)
    try:
        yield calculator
    finally:
        calculator.close()


def results(calculator: RheoCalculator, atoms: ase.Atoms) -> dict[str, np.ndarray]:
    return {name: calculator.get_property(name, atoms) for name in RESULTS}


def outside(reference: EosRefCalculator, other: RheoCalculator, atoms: ase.Atoms) -> set[str]:
    """The results of another calculator that lie outside the bound of the reference."""
    ours, theirs = results(reference, atoms), results(other, atoms)
    bounds = reference.bounds()
    return {name for name in RESULTS if (np.abs(ours[name] - theirs[name]) > bounds[name]).any()}


@pytest.mark.parametrize("name", SHOWN)
def test_both_agree_apart_from_the_named_findings(name: str, ran: Result) -> None:
    scene, atoms = scene_of_case(name), ran.atoms(name)
    with lammps(scene) as engine:
        assert outside(EosRefCalculator(scene, SHOWN[name]), engine, atoms) == set()
        assert outside(EosRefCalculator(scene), engine, atoms) == {"forces"}
        atoms.positions[:2] += atoms.cell.array[0]  # as integrators leave particles that crossed a periodic face
        assert outside(EosRefCalculator(scene, SHOWN[name]), engine, atoms) == set()
        assert np.abs(engine.results["forces"]).max() > 0 and len(engine.results["pressure"]) == len(atoms)
        atoms.arrays["rho"][:] = atoms.get_masses()  # volumes of 1: the factor that the finding omits is 1
        assert outside(EosRefCalculator(scene), engine, atoms) == set()


def test_model_gives_the_results_of_its_scene(ran: Result) -> None:
    name = "external.gravity"
    scene, atoms = scene_of_case(name), ran.atoms(name)
    model = reference_side.model(scene, particles(atoms, scene), "")
    of_scene, of_model = (results(EosRefCalculator(settings), atoms) for settings in (scene, model))
    for result in RESULTS:
        np.testing.assert_array_equal(of_model[result], of_scene[result])
    with lammps(model) as engine:
        assert outside(EosRefCalculator(scene, SHOWN[name]), engine, atoms) == set()


@pytest.mark.parametrize("name", ["constants.metal", "claims-pairs.thermal-shift", "cross-type.both.2d", *SHOWN])
def test_scene_of_a_model_gives_the_same_model(name: str) -> None:
    """Every setting of a model reaches its scene; a force on all types becomes one on each."""
    scene = scene_of_case(name)
    model = reference_side.with_cut(scene, 2.9)
    again = reference_side.with_cut(scene_of(model), 2.9)
    for setting in ("dimension", "fix", "mass_t", "pair", "viscosity", "thermal", "units"):
        assert getattr(again, setting) == getattr(model, setting), setting
    laws = [[vars(law) for law in one.eos.laws] for one in (again, model)]
    assert str(laws[0]) == str(laws[1])
    types = np.arange(1, len(model.mass_t) + 1)
    for one, other in ((again, model), (model, again)):
        acts = [(f.style, f.vector, t) for f in one.forces for t in types[f.acts_on(types)]]
        assert set(acts) == {(f.style, f.vector, t) for f in other.forces for t in types[f.acts_on(types)]}


def test_velocity_verlet_agrees_along_both_trajectories(ran: Result) -> None:
    """Along LAMMPS' trajectory, and along the reference's, both give the same forces; densities are held."""
    name = "tilted.little.fluid"
    scene = scene_of_case(name)
    assert scene.evolve is not None
    with lammps(scene) as engine:
        reference = EosRefCalculator(scene, SHOWN[name])
        for driver, other in ((engine, reference), (reference, engine)):
            atoms = ran.atoms(name)
            start, rho_n = atoms.positions.copy(), atoms.arrays["rho"].copy()
            atoms.calc = driver
            integrator = VelocityVerlet(atoms, timestep=scene.evolve.timestep)
            for _ in range(3):
                integrator.run(1)
                assert outside(reference, other if driver is reference else driver, atoms) == set()
            assert np.abs(atoms.positions - start).max() > 0
            np.testing.assert_array_equal(atoms.arrays["rho"], rho_n)


def test_velocities_and_densities_count_as_changes(ran: Result) -> None:
    atoms = ran.atoms("forces.power.quintic.3d")
    calculator = atoms.calc = EosRefCalculator(scene_of_case("forces.power.quintic.3d"))
    before = atoms.get_forces()
    assert calculator.check_state(atoms) == []
    atoms.set_velocities(2 * atoms.get_velocities())
    moved = atoms.get_forces()
    assert (moved != before).any(), "viscous forces follow velocities"
    atoms.arrays["rho"] *= 1.01
    assert (atoms.get_forces() != moved).any()


def changed(atoms: ase.Atoms, **arrays: object) -> ase.Atoms:
    """Atoms with another array, without one, or with another cell."""
    for name, values in arrays.items():
        if name == "cell":
            atoms.set_cell(values)
        elif values is None:
            del atoms.arrays[name]
        else:
            atoms.arrays[name][:] = values
    return atoms


UPWARD = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
GRAVITY = "external.gravity"


@pytest.mark.parametrize(
    ("use", "line"),
    [
        (lambda of, atoms: of.get_property("forces", changed(atoms, rho=None)), "Atoms: needs the per-atom array rho"),
        (lambda of, atoms: of.get_property("forces", changed(atoms, cell=UPWARD)), "cell: must have edges along x"),
        (
            lambda of, atoms: of.get_property("forces", changed(atoms, type=7)),
            r"type: must lie within 1 to \d, found 7",
        ),
        (lambda of, atoms: EosRefCalculator("scene"), "settings: must be a Scene or a Model, found 'str'"),
        (
            lambda of, atoms: EosRefCalculator(scene_of_case(GRAVITY), ["force-per-volumes"]),
            r"no such finding .*did you mean 'force-per-volume'",
        ),
        (lambda of, atoms: of.bounds(), "bounds: need a calculation first"),
    ],
)
def test_bad_input_is_one_line(use: Callable[..., object], line: str, ran: Result) -> None:
    with pytest.raises(InputError, match=line):
        use(EosRefCalculator(scene_of_case(GRAVITY)), ran.atoms(GRAVITY))


def test_failure_of_lammps_is_a_failed_calculation(ran: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    late = Failure("timeout", "LAMMPS did not finish\n within the time limit")
    monkeypatch.setattr(Workers, "outcome", lambda *arguments: late)
    said = "timeout: LAMMPS did not finish within the time limit"
    with lammps(scene_of_case("external.gravity")) as engine, pytest.raises(CalculationFailed, match=said):
        results(engine, ran.atoms("external.gravity"))
