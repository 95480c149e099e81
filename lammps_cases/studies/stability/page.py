"""The page of an atlas: every map with its pictures, every cell with its numbers and how to run it again."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from eos_ref import InputError
from lammps_cases.pages import frame
from lammps_cases.pages.figures import saved
from lammps_cases.records.files import write_atomically
from lammps_cases.studies.stability import draw, expected, model
from lammps_cases.studies.stability.deck import deck
from lammps_cases.studies.stability.model import CellOutcome, Engine, Kind, MapCell, StabilityMap
from lammps_cases.studies.stability.record import Atlas, MapRecord, read_state
from lammps_cases.studies.stability.runs import watched

ASSETS = Path(__file__).parent / "assets"


@dataclass(frozen=True)
class Shot:
    """A picture of particles: its data as an address, and what it shows."""

    data: str
    caption: str
    alt: str


WHO: dict[Engine, str] = {"lammps": "LAMMPS", "reference": "reference"}


@dataclass(frozen=True)
class CellView:
    """A cell as the page shows it: how it ended on each engine, the path of its deck, its particles."""

    cell: MapCell
    outcomes: dict[Engine, CellOutcome]
    deck: str
    shots: tuple[Shot, ...]

    @property
    def differ(self) -> bool:
        """Whether both engines ran it and ended differently."""
        return len({outcome.kind for outcome in self.outcomes.values()}) > 1


@dataclass(frozen=True)
class MapView:
    """A map as the page shows it."""

    record: MapRecord
    picture: Markup
    rows: list[CellView]

    @property
    def kinds(self) -> dict[Kind, tuple[int, int]]:
        """How often each kind ended a run, on LAMMPS and on the reference."""
        ends = Counter((run.engine, run.outcome.kind) for run in self.record.cells)
        counts: dict[Kind, tuple[int, int]] = {k: (ends["lammps", k], ends["reference", k]) for k in model.KINDS}
        return {kind: count for kind, count in counts.items() if any(count)}

    @property
    def agreement(self) -> str:
        """On how many lines the engines agree."""
        lines = self.record.agreement
        return f"{sum(line.verdict == 'same' for line in lines)} of {len(lines)} lines" if lines else "not compared"


def write(atlas: Atlas, folder: Path, maps: Mapping[str, StabilityMap]) -> None:
    """Write ``report.html``, ``figures/*.svg|png`` and ``decks/*.in``.

    Parameters
    ----------
    maps : mapping
        The maps by id: their theory is drawn, their cells become decks.
    """
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    html = frame.page(
        ASSETS,
        "stability",
        "bad" if expected.unexplained(atlas.disagreements) else "good",
        scripts=[frame.FILTER],
        atlas=atlas,
        colours={kind: colour for kind, (colour, _) in draw.MARKS.items()},
        facts=list(_facts(atlas)),
        maps=[_map(record, maps.get(record.id), folder) for record in atlas.maps],
        disagreements=[
            (record, line, expected.expected_difference(line))
            for record in atlas.maps
            for line in record.agreement
            if line.verdict == "differs"
        ],
        along=along,
    )
    write_atomically(folder / "report.html", html)


def _facts(atlas: Atlas) -> Iterator[tuple[str, str]]:
    yield "LAMMPS", atlas.engine.get("distribution") or atlas.engine.get("version_string", "")
    yield "processor", f"{atlas.machine['processor']}, {atlas.machine['cores']} cores"
    yield "took", f"{atlas.seconds:.0f} s" + (" (quick)" if atlas.quick else "")


def _map(record: MapRecord, of: StabilityMap | None, folder: Path) -> MapView:
    figure = draw.map_figure(record, of.theory if of else (), lambda cell: f"#{cell.anchor}")
    picture = saved(figure, folder / "figures", record.id)
    informative = informative_cells(record)
    decks = {cell: path for cell in informative if of and (path := write_deck(of, cell, folder))}
    return MapView(record, picture, rows(record, folder, decks, informative))


def _outcomes(record: MapRecord) -> dict[MapCell, dict[Engine, CellOutcome]]:
    outcomes: dict[MapCell, dict[Engine, CellOutcome]] = {}
    for run in record.cells:
        outcomes.setdefault(run.cell, {})[run.engine] = run.outcome
    return outcomes


def informative_cells(record: MapRecord) -> set[MapCell]:
    """Return the cells that show a map: where a failure begins, and where the engines end differently."""
    severity = model.KINDS.index
    edges = {b.cell(b.high if severity(b.above) > severity(b.below) else b.low) for b in record.boundaries}
    return edges | {cell for cell, ends in _outcomes(record).items() if len({o.kind for o in ends.values()}) > 1}


def write_deck(of: StabilityMap, cell: MapCell, folder: Path) -> str:
    """Write the deck of a cell; return its path from the page, or nothing where no deck can express it."""
    start, watch = of.start(cell), of.watch(cell)
    scene = watched(start.case.scene, watch)
    note = (f"{of.title}: {cell.name}", cell.command)
    try:
        text = deck(replace(start, case=replace(start.case, scene=scene)), note, watch.every)
    except InputError:
        return ""
    path = f"decks/{cell.anchor}.in"
    write_atomically(folder / path, text)
    return path


def along(kinds: Sequence[Kind], boundaries: Sequence[model.Boundary], record: MapRecord) -> str:
    """Return the kinds along a line, in words."""
    changes = (f"{b.above} from {record.x.name} = {b.low:.4g} to {b.high:.4g} on" for b in boundaries)
    return ", ".join([kinds[0] if kinds else "nothing", *changes])


def rows(record: MapRecord, folder: Path, decks: Mapping[MapCell, str], shown: Container[MapCell]) -> list[CellView]:
    """Return the cells by layer, height and place; with pictures of the particles for those to be shown."""
    outcomes = _outcomes(record)
    views = []
    for cell in sorted(outcomes, key=lambda c: (record.layers.index(c.layer), c.y, c.x)):
        states = {side: read_state(folder, cell, side) for side in WHO if cell in shown}
        shots = tuple(shot(state, WHO[side]) for side, state in states.items() if state is not None)
        views.append(CellView(cell, outcomes[cell], decks.get(cell, ""), shots))
    return views


def shot(state: Mapping[str, Any], who: str) -> Shot:
    """Return the particles before a failure, coloured by density, or by type where all have the same density."""
    rho_n = np.asarray(state["rho"], float)
    finite = rho_n[np.isfinite(rho_n)]
    by_type = finite.size == 0 or bool(np.ptp(finite) == 0)
    failing_n = np.flatnonzero(np.isin(state["id"], state["failing"]))
    colour_n = state["type"] if by_type else rho_n
    png = draw.thumbnail(state["x"], colour_n, failing_n, state["low"], state["high"], by_type)
    colours = "type" if by_type else f"density {finite.min():.3g} to {finite.max():.3g}"
    ring = ", ".join(str(atom) for atom in state["failing"].tolist())
    step = int(state["step"])
    return Shot(
        f"data:image/png;base64,{base64.b64encode(png).decode()}",
        f"{who}, step {step}",
        f"particles of {who} after step {step}, colour: {colours}" + (f"; ringed: {ring}" if ring else ""),
    )
