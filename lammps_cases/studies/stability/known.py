"""Findings of the ledger that explain why LAMMPS and the reference fail at different places."""

from __future__ import annotations

from dataclasses import dataclass

from lammps_cases.studies.stability.lines import Agreement
from lammps_cases.studies.stability.model import Cell


@dataclass(frozen=True)
class Known:
    """A map on which a finding makes the engines differ.

    Attributes
    ----------
    map, layer : where; layer None: on all of them
    finding : id of a ledger entry; none where no statement of the manual is broken
    why : what makes the engines differ
    """

    map: str
    finding: str
    why: str
    layer: str | None = None


_VOLUME = "volumes leave 1 as the fluid is compressed or drawn out, and LAMMPS' forces lack the volume m/rho"
_PUSHED = (
    ("tension", "shift"),
    ("phases", "continuity"),
    ("wall-thickness", None),
    ("wall-stiffness", None),
    ("wall-viscosity", None),
    ("dam-break", None),
    ("column", None),
    ("falling-drop", None),
    ("summed-surface", "rho/sum"),
)
KNOWN: tuple[Known, ...] = (
    *(Known(map, "force-per-volume", _VOLUME, layer) for map, layer in _PUSHED),
    Known("phases", "self-mass-missing", "LAMMPS refuses the keyword", "rho/sum self/mass"),
    Known(
        "matrices-zmin",
        "stale-gradient-below-zmin",
        "gradients of particles below zmin are memory that nobody wrote, so LAMMPS' end depends on what ran before",
        "RK2 run",
    ),
    Known(
        "laws-gas-gamma",
        "",
        "the reference refuses a heat capacity ratio that is none; LAMMPS takes it, the manual is silent",
    ),
    Known("laws-gamma-0", "", "LAMMPS evaluates the power as printed, which loses the digits that gamma has below 1"),
    Known(
        "precision-origin",
        "",
        "particles that rounding puts on top of each other: refused by the reference, not by LAMMPS",
    ),
)


def finding(line: Agreement | Cell) -> Known | None:
    """What explains that the engines differ on a line, or in a cell; None: nothing known."""
    return next((k for k in KNOWN if k.map == line.map and k.layer in (None, line.layer)), None)


def unexplained(lines: list[Agreement]) -> list[Agreement]:
    """The lines that differ for no known reason."""
    return [line for line in lines if finding(line) is None]
