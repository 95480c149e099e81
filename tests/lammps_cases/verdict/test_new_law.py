"""A new equation of state needs its formulas and its record, and nothing else.

A copy of both packages is given a stiffened gas, P = (gamma - 1) rho e - c^2 rho0, by edits of a few files; then
every use of a law is tried with it, in a separate process.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import eos_ref

ROOT = Path(eos_ref.__file__).parents[1]
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
EDITS = {
    "eos_ref/eos/laws.py": lambda text: text + FORMULAS,
    "eos_ref/eos/lammps_rounding.py": lambda text: text + ROUNDINGS,
    "eos_ref/eos/registry.py": lambda text: (
        text.replace('"ideal/gas"]', '"ideal/gas", "stiffened/gas"]')
        .replace("\nLAWS: dict", RECORD)
        .replace("IDEAL_GAS)}", "IDEAL_GAS, STIFFENED)}")
    ),
}


@pytest.mark.slow
def test_new_law_needs_edits_of_three_files(tmp_path: Path) -> None:
    for package in ("eos_ref", "lammps_cases"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name, edit in EDITS.items():
        file = tmp_path / name
        before = file.read_text(encoding="utf-8")
        file.write_text(edit(before), encoding="utf-8")
        assert file.read_text(encoding="utf-8") != before
    script = Path(__file__).parents[2] / "support" / "use_new_law.py"
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    ran = subprocess.run([sys.executable, str(script)], env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.strip() == "stiffened/gas"
