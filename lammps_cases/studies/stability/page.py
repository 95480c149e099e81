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
from lammps_cases.studies.stability import draw, expected, names
from lammps_cases.studies.stability.deck import deck
from lammps_cases.studies.stability.inputs import InputRow
from lammps_cases.studies.stability.lines import Agreement
from lammps_cases.studies.stability.model import (
    KINDS,
    Boundary,
    CellOutcome,
    CellRun,
    Engine,
    Kind,
    MapCell,
    StabilityMap,
)
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
    """A cell as the page shows it."""

    cell: MapCell
    anchor: str
    lammps: CellOutcome | None
    reference: CellOutcome | None
    command: str
    deck: str
    shots: tuple[Shot, ...]

    @property
    def differ(self) -> bool:
        """Whether both engines ran it and ended differently."""
        return self.lammps is not None and self.reference is not None and self.lammps.kind != self.reference.kind


@dataclass(frozen=True)
class MapView:
    """A map as the page shows it; ``kinds``: how many runs end so, on LAMMPS and on the reference."""

    record: MapRecord
    picture: Markup
    rows: list[CellView]
    kinds: dict[Kind, tuple[int, int]]
    agreement: str


@dataclass(frozen=True)
class EngineDifference:
    """A line on which the engines differ, in words."""

    map: str
    title: str
    layer: str
    line: str
    lammps: str
    reference: str
    finding: str


def write(atlas: Atlas, folder: Path, maps: Mapping[str, StabilityMap], inputs: Sequence[InputRow] = ()) -> None:
    """Write ``report.html``, ``figures/*.svg|png`` and ``decks/*.in``.

    Parameters
    ----------
    maps : mapping
        The maps by id: their theory is drawn, their cells become decks.
    inputs : sequence of InputRow
        What LAMMPS does with bad input.
    """
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
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
            _difference(line, record) for record in atlas.maps for line in record.agreement if line.verdict == "differs"
        ],
        inputs=inputs,
        reactions=Counter(row.reaction for row in inputs),
    )
    write_atomically(folder / "report.html", html)


def _facts(atlas: Atlas) -> Iterator[tuple[str, str]]:
    yield "LAMMPS", atlas.engine.get("distribution") or atlas.engine.get("version_string", "")
    yield "processor", f"{atlas.machine['processor']}, {atlas.machine['cores']} cores"
    yield "took", f"{atlas.seconds:.0f} s" + (" (quick)" if atlas.quick else "")


def _map(record: MapRecord, of: StabilityMap | None, folder: Path) -> MapView:
    figure = draw.map_figure(record, of.theory if of else (), lambda cell: "#" + names.anchor(cell))
    picture = saved(figure, folder / "figures", record.id)
    telling = informative_cells(record)
    decks = {cell: path for cell in telling if of and (path := write_deck(of, cell, folder))}
    same = sum(line.verdict == "same" for line in record.agreement)
    agreement = f"{same} of {len(record.agreement)} lines" if record.agreement else "not compared"
    return MapView(record, picture, rows(record, folder, decks, telling), kinds(record.cells), agreement)


def informative_cells(record: MapRecord) -> set[MapCell]:
    """Return the cells that show a map: where a failure begins, and where the engines end differently."""
    cells = {
        MapCell(b.map, b.high if KINDS.index(b.above) > KINDS.index(b.below) else b.low, b.y, b.layer)
        for b in record.boundaries
    }
    ends: dict[MapCell, set[Kind]] = {}
    for r in record.cells:
        ends.setdefault(r.cell, set()).add(r.outcome.kind)
    return cells | {cell for cell, both in ends.items() if len(both) > 1}


def write_deck(of: StabilityMap, cell: MapCell, folder: Path) -> str:
    """Write the deck of a cell; its path from the page, or nothing where no deck can say it."""
    start, watch = of.start(cell), of.watch(cell)
    scene = watched(start.case.scene, watch)
    note = (f"{of.title}: {names.name(cell)}", names.command(cell))
    try:
        text = deck(replace(start, case=replace(start.case, scene=scene)), note, watch.every)
    except InputError:
        return ""
    path = f"decks/{names.anchor(cell)}.in"
    write_atomically(folder / path, text)
    return path


def _difference(line: Agreement, record: MapRecord) -> EngineDifference:
    ours, theirs = line.boundaries
    reason = expected.expected_difference(line)
    return EngineDifference(
        record.id,
        record.title,
        line.layer,
        f"{record.y.name} = {line.y:.5g}",
        along(line.lammps, theirs, record),
        along(line.reference, ours, record),
        f"{reason.finding or 'no finding'}: {reason.why}" if reason else "",
    )


def along(ends: Sequence[Kind], boundaries: Sequence[Boundary], record: MapRecord) -> str:
    """Return the kinds along a line, in words."""
    text = str(ends[0]) if ends else "nothing"
    for b in boundaries:
        text += f", {b.above} from {record.x.name} = {b.low:.4g} to {b.high:.4g} on"
    return text


def rows(record: MapRecord, folder: Path, decks: Mapping[MapCell, str], shown: Container[MapCell]) -> list[CellView]:
    """Return the cells by layer, height and place; with pictures of the particles for those to be shown."""
    outcomes: dict[MapCell, dict[Engine, CellOutcome]] = {}
    for r in record.cells:
        outcomes.setdefault(r.cell, {})[r.engine] = r.outcome
    views = []
    for cell in sorted(outcomes, key=lambda c: (record.layers.index(c.layer), c.y, c.x)):
        states = {side: read_state(folder, cell, side) for side in WHO if cell in shown}
        views.append(
            CellView(
                cell,
                names.anchor(cell),
                outcomes[cell].get("lammps"),
                outcomes[cell].get("reference"),
                names.command(cell),
                decks.get(cell, ""),
                tuple(shot(state, WHO[side]) for side, state in states.items() if state is not None),
            )
        )
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
    return Shot(
        f"data:image/png;base64,{base64.b64encode(png).decode()}",
        f"{who}, step {int(state['step'])}",
        f"particles of {who} after step {int(state['step'])}, colour: {colours}"
        + (f"; ringed: {ring}" if ring else ""),
    )


def kinds(ran: Sequence[CellRun]) -> dict[Kind, tuple[int, int]]:
    """Return how often each kind ended a run, on LAMMPS and on the reference."""
    ends = Counter((r.engine, r.outcome.kind) for r in ran)
    counted: dict[Kind, tuple[int, int]] = {k: (ends["lammps", k], ends["reference", k]) for k in KINDS}
    return {kind: count for kind, count in counted.items() if any(count)}
