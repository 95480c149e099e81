"""A new equation of state is complete with its formulas, its record and its rows in NUMERICS.md.

A copy of both packages is given a stiffened gas, P = (gamma - 1) rho e - c^2 rho0; then every use of a law is tried
with it, in a separate process: command text, scene, schema, bounds, lint, chart, flows, audit.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.walk import after, walk

FORMULAS = '''

def stiffened_gas(rho: Number, e: Number, rho0: Number, cs: Number, gamma: Number) -> Number:
    """Stiffened gas."""
    return (gamma - 1) * rho * e - cs * cs * rho0


def stiffened_gas_density(p: Number, e: Number, rho0: Number, cs: Number, gamma: Number) -> Number:
    """Its inverse."""
    return (p + cs * cs * rho0) / ((gamma - 1) * e)
'''
ROUNDINGS = '''

def stiffened_gas(
    rho: FloatArray, energy: FloatArray, mass: FloatArray, rho0: float, cs: float, gamma: float
) -> FloatArray:
    """Stiffened gas."""
    return (gamma - 1.0) * rho * energy / mass - cs * cs * rho0
'''
RECORD = """
STIFFENED = Law(
    "stiffened/gas",
    pressure=lambda rho, e, rho0, cs, gamma: laws.stiffened_gas(rho, e, rho0, cs, gamma),
    density=lambda p, e, rho0, cs, gamma: laws.stiffened_gas_density(p, e, rho0, cs, gamma),
    stiffness=lambda rho, e, rho0, cs, gamma: laws.ideal_gas_stiffness(e + 0 * rho, gamma),
    terms=lambda rho, e, rho0, cs, gamma: (gamma + 1) * np.abs(rho * e) + cs * cs * rho0,
    terms_text="(gamma + 1) |rho e| + c^2 rho0",
    roundings=lambda _: 5,  # gamma - 1, rho, energy, mass, difference
    reference_eps=3,  # gamma - 1, rho, energy, difference, background
    lammps=lambda rho, energy, mass, rho0, cs, gamma: lammps_rounding.stiffened_gas(rho, energy, mass, rho0, cs, gamma),
    parameter="gamma",
    allows=lambda gamma: gamma > 1,
    rule="must exceed 1 (a heat capacity ratio)",
    energy=IDEAL_GAS.energy,
    example=1.7,
)

LAWS: dict"""
ROW = "| `stiffened/gas` $\\gamma$ | $(\\gamma-1)\\rho e - c^2\\rho_0$ | $(P + c^2\\rho_0)/((\\gamma-1)e)$ |\n"
BOUND = "| `stiffened/gas` (gamma = 1.7) | 5 | (gamma + 1) \\|rho e\\| + c^2 rho0 | 3 |\n"
EDITS = {
    "eos_ref/eos/laws.py": lambda text: text + FORMULAS,
    "eos_ref/eos/lammps_rounding.py": lambda text: text + ROUNDINGS,
    "eos_ref/eos/registry.py": lambda text: text.replace("\nLAWS: dict", RECORD).replace(
        "IDEAL_GAS)}", "IDEAL_GAS, STIFFENED)}"
    ),
    "eos_ref/NUMERICS.md": lambda text: after("(\\gamma-1)e)$ |\n", ROW)(
        after("(gamma + 1) \\|rho e\\| | 2 |\n", BOUND)(text)
    ),
}


@pytest.mark.slow
def test_new_law_is_complete_in_four_files(tmp_path: Path) -> None:
    assert len(EDITS) <= 4
    assert walk(tmp_path, EDITS, "use_new_law.py") == "stiffened/gas"
