"""A map made without runs: outcomes by a formula, on two engines that differ where the formula does."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from lammps_cases.studies.flows.flow import Options, Start, rows, start
from lammps_cases.studies.stability import model
from lammps_cases.studies.stability.atlas import agreement, boundaries
from lammps_cases.studies.stability.model import (
    Atlas,
    Axis,
    Boundary,
    CellOutcome,
    CellRun,
    Engine,
    FailureCriteria,
    Kind,
    MapCell,
    MapLine,
    MapRecord,
    StabilityMap,
    Theory,
)

PLACES = (0.1, 0.4, 1.6, 6.4)
TEXT = "ERROR: <lost> & gone"


def begun(cell: MapCell) -> Start:
    """Fluid at rest."""
    kind = {"mass": 1.0, "rho0": 1.0, "cs": 1.0, "viscosity": cell.y}
    scene = {"types": [kind], "pressure": [{"types": "*", "style": "linear"}]}
    dt = 0.01 * cell.x
    return start("rest", scene, rows(0, 6, 9), (9.0, 6.0), options=Options(), times=[2 * dt], timestep=dt)


MAP = StabilityMap(
    "made",
    "A <made> map",
    "About it & more.",
    Axis("dt", 0.1, 6.4, 0.05, log=True),
    Axis("nu", 0.1, 10.0, 0.1, log=True),
    (0.1, 1.0, 10.0),
    begun,
    lambda cell: FailureCriteria(every=1),
    layers=("plain", "with <shift>"),
    theory=(Theory("costs $1 and $2", lambda y: 0.5), Theory("of one layer", lambda y: 1 / y, "plain")),
)


def kind(cell: MapCell, engine: Engine) -> Kind:
    """How a cell ends: beyond 1 energy grows, beyond 5 LAMMPS loses particles at nu = 10."""
    if cell.x < 1:
        return "stable"
    return "lost particles" if engine == "lammps" and cell.x > 5 and cell.y == 10.0 else "energy growth"


def outcome(cell: MapCell, engine: Engine) -> CellOutcome:
    """The outcome of a cell, with the atom and step of a failure, and LAMMPS' text if any."""
    ends = kind(cell, engine)
    if ends == "stable":
        return CellOutcome(ends, seconds=0.5, steps=9)
    return CellOutcome(ends, 7, 12, 345.678, TEXT if ends == "lost particles" else "", 0.5, 9)


def made_map() -> MapRecord:
    """All cells of both layers."""
    ran, edges, verdicts = [], list[Boundary](), []
    for layer, y in itertools.product(MAP.layers, MAP.lines):
        ends: dict[Engine, dict[float, Kind]] = {"reference": {}, "lammps": {}}
        for engine, by_place in ends.items():
            for x in PLACES:
                cell = MapCell(MAP.id, x, y, layer)
                ran.append(CellRun(cell, engine, outcome(cell, engine)))
                by_place[x] = kind(cell, engine)
            edges += boundaries(MapLine(MAP.id, layer, y, engine), by_place)
        verdicts.append(agreement(MAP, layer, y, ends["reference"], ends["lammps"]))
    told = MAP.id, MAP.title, MAP.about, MAP.x, MAP.y, MAP.layers, MAP.lines
    return MapRecord(*told, 24.0, tuple(ran), tuple(edges), tuple(verdicts))


def made_atlas(folder: Path) -> Atlas:
    """The map in an atlas, with the particles before each failure in the folder."""
    made = made_map()
    x_nc = rows(0, 6, 9)
    rho_n = 1 + 0.001 * np.arange(54)
    before = {
        **{"step": np.array(6), "failing": np.array([12]), "low": np.zeros(2), "high": np.array([9.0, 6.0])},
        **{"x": x_nc, "v": 0 * x_nc, "rho": rho_n, "pressure": rho_n},
        **{"id": np.arange(1, 55), "type": np.ones(54, int)},
    }
    for ran in made.cells:
        if ran.outcome.kind != "stable":
            model.write_state(folder, ran.cell, ran.engine, before)
    about = {"processor": "p", "cores": 2, "load": 0.1}
    return Atlas("eos-ref stability made", about, {"distribution": "1"}, False, 24.0, (made,))
