"""Fix rheo/pressure keeps the digits of Tait's law near the equilibrium density: python python-eosref-tait.py.

Every pressure is compared with the manual's formula, evaluated with 60 digits for the same double precision density.
"""

from __future__ import annotations

import sys
import unittest
from collections.abc import Sequence
from decimal import Decimal, getcontext
from typing import Any

from lammps import lammps

getcontext().prec = 60
CS = 7.5
# Roundings of a form that takes rho - rho0 first; the largest number of them is derived next to the form.
TOLERANCE = 32 * 2.0**-53
COMPRESSIONS = [sign * 10.0**-k for k in range(2, 15) for sign in (1, -1)]


def pressures(law: str, rho0: float, rho_n: Sequence[float]) -> list[float]:
    """Return what LAMMPS outputs as the pressure of particles at rest with given densities."""
    lmp: Any = lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    try:
        lmp.commands_string(f"""
            units lj
            dimension 2
            atom_style rheo
            atom_modify map array
            comm_modify vel yes
            region box block 0 {len(rho_n)} 0 8 -0.5 0.5
            create_box 1 box
            mass 1 1.0""")
        for k, rho in enumerate(rho_n, 1):
            lmp.command(f"create_atoms 1 single {k - 0.5} 4.0 0.0")
            lmp.command(f"set atom {k} rheo/rho {rho!r}")
        lmp.commands_string(f"""
            fix 1 all rheo 3.0 quintic 0 density {rho0!r} speed/sound {CS!r}
            fix 2 all rheo/viscosity * constant 0.1
            fix 3 all rheo/pressure * {law}
            pair_style rheo 3.0
            pair_coeff * *
            compute p all rheo/property/atom pressure
            run 0 post no""")
        values = dict(zip(lmp.numpy.extract_atom("id").tolist(), lmp.numpy.extract_compute("p", 1, 1), strict=False))
        return [float(values[k]) for k in range(1, len(rho_n) + 1)]
    finally:
        lmp.close()


def exact(gamma: str, rho0: float, rho: float) -> Decimal:
    """Return c^2 rho0/gamma ((rho/rho0)^gamma - 1)."""
    power = (Decimal(rho) / Decimal(rho0)) ** Decimal(gamma)
    return Decimal(CS) ** 2 * Decimal(rho0) / Decimal(gamma) * (power - 1)


class RheoTait(unittest.TestCase):
    """Relative errors of pressures."""

    def check(self, law: str, gamma: str) -> None:
        """Compare the law at compressions of either sign."""
        rho0 = 1.2345
        rho_n = [rho0 * (1 + d) for d in COMPRESSIONS]
        errors = {}
        for d, rho, p in zip(COMPRESSIONS, rho_n, pressures(law, rho0, rho_n), strict=True):
            right = exact(gamma, rho0, rho)
            errors[d] = float(abs((Decimal(p) - right) / right))
        worst = max(errors, key=errors.__getitem__)
        self.assertLessEqual(errors[worst], TOLERANCE, f"{law} at a compression of {worst:g}")

    def test_water(self) -> None:
        """The exponent 7."""
        self.check("tait/water", "7")

    def test_general(self) -> None:
        """Any exponent."""
        self.check("tait/general 1.25", "1.25")

    def test_equilibrium(self) -> None:
        """No pressure at the equilibrium density, also where rho0 (1/rho0) is not 1 in double precision."""
        for law in ("tait/water", "tait/general 1.25"):
            self.assertEqual(pressures(law, 49.0, [49.0]), [0.0])


if __name__ == "__main__":
    sys.argv[1:1] = ["-q"]
    unittest.main()
