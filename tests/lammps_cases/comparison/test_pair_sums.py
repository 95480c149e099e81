"""The contributions of a particle's pairs add up to its fields, in the units of the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lammps_cases.comparison.pair_sums import (
    PairContribution,
    ParticleValues,
    Sum,
    added_up,
    columns,
    sums,
    terms,
)
from lammps_cases.comparison.trajectory import halted, predict
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of
from tests.support.roundings import rounded

PARTS = {"f": "force", "drho": "drho", "heatflow": "heat"}


@pytest.mark.parametrize(
    ("name", "fields"), [("forces.all.rk1.3d", ("f", "drho")), ("thermal.arithmetic.3d", ("f", "heatflow"))]
)
def test_pairs_add_up_to_the_fields(name: str, fields: tuple[str, ...]) -> None:
    (case,) = casefile.select(casefile.load(), [name])
    problem = problem_of(case.scene, prepare(case).atoms, "", (0,))
    problem = replace(problem, model=replace(problem.model, units="real", forces=()), fields=(*fields, "pressure"))
    prediction = predict(problem)
    (values,), (bounds,) = prediction.fields, prediction.bounds
    state, consistent = problem.state, halted(problem, (0,))[0]
    unit, held, laws = consistent.units.of, consistent.state, consistent.model
    for row in (0, 7, len(state.rho_n) - 1):
        of = terms(problem, 0, row + 1, len(state.rho_n) ** 2, forces=True)
        assert len(of.pairs) == of.count > 0 and of.pairs[0].r == min(pair.r for pair in of.pairs)
        added = added_up(of.pairs)
        for field in fields:
            assert (np.abs(added[PARTS[field]] - values[field][row]) <= bounds[field][row]).all(), field
        for one in (of.particle, *(pair.other for pair in of.pairs)):
            at = one.id - 1
            assert (one.type, one.solid, one.x) == (state.type_n[at], state.solid_n[at], tuple(state.x_nc[at]))
            assert one.v == tuple(state.v_nc[at])
            assert one.mass == problem.model.mass_t[one.type - 1] and one.rho == held.rho_n[at] / unit("rho")
            assert one.volume == one.mass / held.rho_n[at] and one.pressure == values["pressure"][at]
            law = laws.eos.laws[one.type - 1]
            assert (one.constants["rhoeq"], one.constants["cs"]) == (law.rho0 / unit("rho"), law.cs)
            if held.energy_n is not None and laws.thermal is not None:
                thermal = laws.thermal[one.type - 1]
                assert one.constants["kappa"] == thermal.conductivity / unit("conductivity")
                assert one.constants["cv"] == thermal.specific_heat / unit("cv")
                assert one.constants["E"] == held.energy_n[at] / unit("energy")
        # A square, two sums and a root on either side.
        assert all(pair.r == rounded(np.linalg.norm(pair.x), 2 * 4) and pair.w > 0 for pair in of.pairs)
        assert all(np.dot(pair.gradient, pair.x) < 0 for pair in of.pairs), "kernels fall with the distance"


def test_forces_of_fixes_are_listed_with_those_of_pairs() -> None:
    """If the model has them and contributions of pairs are requested."""
    (case,) = casefile.select(casefile.load(), ["walls.stored.gravity"])
    problem = problem_of(case.scene, prepare(case).atoms, "", (0,))
    sim = halted(problem, (0,))[0]
    with_pairs, without = (sums(sim, (3,), forces=forces)[0] for forces in (True, False))
    assert with_pairs.force_with_fixes == tuple(sim.output("f")[3])
    assert without.force_with_fixes == () and not without.pairs[0].force
    plain = replace(sim.model, forces=())
    of = halted(replace(problem, model=plain), (0,))[0]
    assert sums(of, (3,), forces=True)[0].force_with_fixes == ()


def test_solids_are_distinguished_from_fluids() -> None:
    (case,) = casefile.select(casefile.load(), ["walls.stored.gravity"])
    problem = problem_of(case.scene, prepare(case).atoms, "", (0,))
    of = sums(halted(problem, (0,))[0], range(len(problem.state.x_nc)))
    assert [each.particle.solid for each in of] == problem.state.solid_n.tolist()
    assert any(each.particle.solid for each in of) and not all(each.particle.solid for each in of)


def test_without_viscosity_the_force_is_that_of_pressure(case_file: Callable[..., Path]) -> None:
    """In units real, for a gas whose pressure follows from its energy."""
    gas = {"pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.4}], "energy": {"range": [0.5, 2.5]}}
    cube = {"dimension": 3, "positions": {"lattice": "sc", "spacing": 0.8, "cells": [4, 4, 4], "disorder": 0.2}}
    (case,) = casefile.load_file(case_file(**gas, **cube, compare=["f", "pressure"], units="real"))
    problem = problem_of(case.scene, prepare(case).atoms, "", (0,))
    (values,) = predict(problem).fields
    of = terms(problem, 0, 8, forces=True)
    assert of.pairs and all(pair.force == pair.pressure_force and any(pair.force) for pair in of.pairs)
    assert of.particle.pressure == values["pressure"][7]


def test_particles_have_individual_masses() -> None:
    (case,) = casefile.select(casefile.load(), ["masses.plain.2d"])
    problem = problem_of(case.scene, prepare(case).atoms, "", (0,))
    assert problem.state.mass_n is not None
    of = terms(problem, 0, 5)
    assert of.particle.mass == problem.state.mass_n[4] != problem.model.mass_t[of.particle.type - 1]


# --- as arrays


def particle(number: int) -> ParticleValues:
    return ParticleValues(number, 1, False, (0.0, 0.0), (0.0, 0.0), 1.0, 1.0, 1.0, 0.0, {})


def pair(other: int, force: tuple[float, ...], drho: float | None, heat: float | None) -> PairContribution:
    return PairContribution(particle(other), (0.5, 0.0), 0.5 * other, 1.0, (-1.0, 0.0), force, force, drho, heat)


@pytest.mark.parametrize(("drho", "heat", "rates"), [(None, None, []), (2.0, None, ["drho"]), (None, 3.0, ["heat"])])
@pytest.mark.parametrize("dimension", [2, 3])
def test_particles_and_their_pairs_are_separate_rows(
    dimension: int, drho: float | None, heat: float | None, rates: list[str]
) -> None:
    force = (1.0, -2.0, 4.0)[:dimension]
    pairs = (pair(4, force, drho, heat), pair(9, force, drho, heat))
    arrays = columns([(0, Sum(particle(7), (), 0)), (10, Sum(particle(3), pairs, 2))])
    names = [f"{name} {axis}" for name in ("force", "pressure_force") for axis in "xyz"[:dimension]]
    values = [*force, *force, *(rate for rate in (drho, heat) if rate is not None)]
    assert {name: (array.dtype.kind, array.tolist()) for name, array in arrays.items()} == {
        "step": ("i", [0, 10]),
        "row": ("i", [6, 2]),
        "count": ("i", [0, 2]),
        "other": ("i", [3, 8]),
        "r": ("f", [2.0, 4.5]),
        "names": ("U", names + rates),
        "pair": ("f", [values, values]),
        "sum": ("f", [[0.0] * len(values), [2 * value for value in values]]),
    }


def test_particle_without_neighbours_has_no_columns() -> None:
    arrays = columns([(0, Sum(particle(7), (), 0))])
    assert {name: array.dtype.kind for name, array in arrays.items()} == {
        **dict.fromkeys(("step", "row", "count", "other"), "i"),
        **dict.fromkeys(("r", "pair", "sum"), "f"),
        "names": "U",
    }
    assert arrays["count"].tolist() == [0] and arrays["sum"].shape == (1, 0)
