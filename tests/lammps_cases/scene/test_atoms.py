"""Particles of a scene: sites and boxes of lattices, types, assigned fields, and refused input."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.atoms import Atoms, seed

Write = Callable[..., Path]
ORDERED = {"lattice": "sq", "spacing": 0.5, "cells": [4, 3]}
TWO = [{"mass": 2.0, "rho0": 1.0, "cs": 1.0}, {"mass": 3.0, "rho0": 4.0, "cs": 1.0}]


def atoms_of(file: Path) -> Atoms:
    (case,) = casefile.load((file,))
    return prepared_case.prepare(case).atoms


@pytest.mark.parametrize(
    ("lattice", "cells", "count", "high", "nearest"),
    [
        ("sq", [4, 3], 12, [2.0, 1.5], 0.5),
        ("hex", [4, 3], 24, [2.0, 1.5 * 3**0.5], 0.5),
        ("sc", [3, 3, 3], 27, [1.5, 1.5, 1.5], 0.5),
        ("bcc", [2, 2, 2], 16, [1.0, 1.0, 1.0], 0.5 * 0.75**0.5),
        ("fcc", [2, 2, 2], 32, [1.0, 1.0, 1.0], 0.5 * 0.5**0.5),
    ],
)
def test_lattice_fills_its_periodic_box(
    case_file: Write, lattice: str, cells: list[int], count: int, high: list[float], nearest: float
) -> None:
    d = len(cells)
    atoms = atoms_of(case_file(dimension=d, positions={"lattice": lattice, "spacing": 0.5, "cells": cells}))
    assert len(atoms) == count
    np.testing.assert_allclose(atoms.high_c[:d], high, rtol=4 * 2.0**-53)  # a root and a product on either side
    apart_ppc = atoms.x_nc[:, None, :d] - atoms.x_nc[None, :, :d]
    apart_ppc -= np.round(apart_ppc / high) * high
    r_pp = np.sqrt((apart_ppc**2).sum(axis=-1)) + 9.0 * np.eye(count)
    # Two roundings of each position, up to six times as long; the difference, two squares and sums, and the root.
    np.testing.assert_allclose(r_pp.min(axis=1), nearest, rtol=(2 * 2 * 6 + 6) * 2.0**-53)


def test_open_faces_have_a_margin(case_file: Write) -> None:
    atoms = atoms_of(case_file(positions={**ORDERED, "periodic": [True, False], "margin": 2.0}))
    assert atoms.periodic == (True, False, True)
    np.testing.assert_array_equal(atoms.low_c, [0.0, -1.0, -0.25])
    np.testing.assert_array_equal(atoms.high_c, [2.0, 2.5, 0.25])


def test_particles_are_listed_one_by_one(case_file: Write) -> None:
    listed = {"x": [[0.25, 1.0], [1.5, 0.5]], "types": [2, 1], "low": [0.0, -1.0], "high": [2.0, 2.0]}
    scene = {"types": TWO, "rho": {"values": [0.9, 1.1]}, "velocity": {"values": [[1.0, 2.0], [0.0, -3.0]]}}
    atoms = atoms_of(case_file(positions={**listed, "periodic": [True, False], "spacing": 0.5}, **scene))
    assert atoms.type_n.tolist() == [2, 1]
    assert atoms.x_nc.tolist() == [[0.25, 1.0, 0.0], [1.5, 0.5, 0.0]]
    assert (atoms.low_c.tolist(), atoms.high_c.tolist()) == ([0.0, -1.0, -0.25], [2.0, 2.0, 0.25])
    assert (atoms.periodic, atoms.spacing) == ((True, False, True), 0.5)
    assert atoms.v_nc is not None and atoms.v_nc.tolist() == [[1.0, 2.0, 0.0], [0.0, -3.0, 0.0]]
    assert atoms.rho_n is not None and atoms.rho_n.tolist() == [0.9, 1.1]
    plain = atoms_of(case_file(positions=listed, **scene | {"types": TWO}, name="plain"))
    assert (plain.periodic, plain.spacing) == ((True, True, True), 1.0)


def test_regions_give_types_and_remove_particles(case_file: Write) -> None:
    regions = [
        {"type": 2, "low": [0.0, 0.0], "high": [1.0, 0.5]},
        {"type": None, "low": [0.75, 0.0], "high": [1.0, 1.0]},
    ]
    atoms = atoms_of(case_file(types=TWO, positions={**ORDERED, "regions": regions}))
    assert len(atoms) == 9
    np.testing.assert_array_equal(atoms.type_n, np.where(atoms.x_nc[:, 1] < 0.75, 2, 1))
    np.testing.assert_array_equal(atoms.mass_n, np.where(atoms.type_n == 2, 3.0, 2.0))


def test_region_without_sites_is_refused(case_file: Write) -> None:
    """Corners in units of length, where fractions are meant, would leave out a type without a word."""
    lengths = {"type": 2, "low": [1.0, 1.0], "high": [2.0, 1.5]}
    with pytest.raises(InputError, match=r"low \[1.0, 1.0\] and high \[2.0, 1.5\] enclose no site; they are fractions"):
        atoms_of(case_file(types=TWO, positions={**ORDERED, "regions": [lengths]}))


def test_energy_per_type_is_multiplied_by_mass(case_file: Write) -> None:
    atoms = atoms_of(
        case_file(
            types=TWO,
            pressure=[{"types": "*", "style": "ideal/gas", "gamma": 1.4}],
            energy={"per_type": [5.0, 7.0]},
        )
    )
    np.testing.assert_array_equal(atoms.energy_n, np.where(atoms.type_n == 1, 10.0, 21.0))


def test_density_ratios_are_relative_to_rho0_of_each_type(case_file: Write) -> None:
    atoms = atoms_of(case_file(types=TWO, rho={"ratio": [0.5, 1.5]}))
    rho0_n = np.where(atoms.type_n == 1, 1.0, 4.0)
    # The product with the density and the quotient by it; a product and a sum of the ratios, on either side.
    np.testing.assert_allclose(
        np.sort(atoms.rho_n / rho0_n), np.linspace(0.5, 1.5, len(atoms)), rtol=(2 + 2 * 2) * 2.0**-53
    )


def test_density_offsets_are_geometric_on_both_sides(case_file: Write) -> None:
    atoms = atoms_of(case_file(rho={"offset": {"low": 1e-6, "high": 1e-2}}))
    d_n = np.sort(np.abs(atoms.rho_n / 1.2 - 1))
    # The product with 1.2, the quotient by it and the difference round like numbers near 1.
    np.testing.assert_allclose(d_n, np.geomspace(1e-6, 1e-2, 20), rtol=4 * 2.0**-53, atol=4 * 2.0**-53)
    assert (atoms.rho_n < 1.2).sum() == 10


def test_seed_depends_on_the_name_alone() -> None:
    assert seed("one") == seed("one") != seed("two")
    assert 0 <= seed("one") < 2**64
