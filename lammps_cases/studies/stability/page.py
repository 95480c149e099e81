"""The page of an atlas: every map with its pictures, every cell with its numbers and the command to run it."""

from __future__ import annotations

import base64
import math
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from eos_ref import InputError
from lammps_cases.engine.session import Job, RunCommand
from lammps_cases.records.files import write_atomically
from lammps_cases.records.wording import number
from lammps_cases.report.pages import blocks, frame
from lammps_cases.report.pages.blocks import Block, Details, PageRow, PageSection, PageTable, Paragraph, Picture
from lammps_cases.report.pages.figures import saved
from lammps_cases.setup.commands import job
from lammps_cases.setup.deck import until_first_run
from lammps_cases.setup.plan import plan
from lammps_cases.studies.flows.flow import Start
from lammps_cases.studies.stability import draw, model
from lammps_cases.studies.stability.maps import expected_difference, unexplained
from lammps_cases.studies.stability.model import Atlas, CellOutcome, Engine, MapCell, MapRecord, StabilityMap
from lammps_cases.studies.stability.runs import watched

ASSETS = Path(__file__).parents[1] / "assets"
WHO: dict[Engine, str] = {"lammps": "LAMMPS", "reference": "reference"}
ABOUT = """Every mark is a run (a cell), coloured by how it ended. Between neighbours that end differently the
boundary is bisected along the horizontal axis; bands are what is left of the uncertainty. A click on a mark leads to
its numbers and to the command that runs it again."""


def write(atlas: Atlas, folder: Path, maps: Mapping[str, StabilityMap]) -> None:
    """Write ``report.html``, ``figures/*.svg|png`` and ``decks/*``.

    Parameters
    ----------
    maps : mapping
        The maps by id: their theory is drawn, their cells become decks.
    """
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    columns = ["map", "#cells", "#runs", "how they end (LAMMPS / reference)", "agreement", "#seconds"]
    overview = PageTable(columns, [_ends(record) for record in atlas.maps])
    html = blocks.page(
        "stability",
        "Where methods fail: LAMMPS and the reference",
        "where methods fail",
        [Paragraph(ABOUT, "about")],
        [
            PageSection("overview", "Maps", [overview]),
            PageSection("disagreements", "Where LAMMPS and the reference differ", [_disagreements(atlas)]),
            *(_section(record, maps.get(record.id), folder) for record in atlas.maps),
        ],
        engine=atlas.label,
        command=atlas.command,
        facts=atlas.facts,
        status="bad" if unexplained(atlas.disagreements) else "good",
        styles=[ASSETS / "stability.css"],
        scripts=[frame.FILTER, ASSETS / "stability.js"],
    )
    write_atomically(folder / "report.html", html)


def _badge(kind: model.Kind) -> Markup:
    colour = draw.MARKS[kind][0]
    return Markup('<span class="kind"><span class="mark" style="background: {}"></span>{}</span>').format(colour, kind)


def _ends(record: MapRecord) -> list[object]:
    """Return the row of a map: how many runs ended in each way on either engine, on how many lines they agree."""
    ends = Counter((run.engine, run.outcome.kind) for run in record.cells)
    counts = {kind: (ends["lammps", kind], ends["reference", kind]) for kind in model.KINDS}
    count = Markup('<span class="count">{} {} / {}</span> ')
    shown = Markup("").join(count.format(_badge(kind), *pair) for kind, pair in counts.items() if any(pair))
    lines = record.agreement
    agree = f"{sum(line.verdict == 'same' for line in lines)} of {len(lines)} lines" if lines else "not compared"
    cells = len({run.cell for run in record.cells})
    title = blocks.link(f"#map-{record.id}", record.title)
    return [title, cells, len(record.cells), shown, agree, f"{record.seconds:.1f}"]


def _disagreements(atlas: Atlas) -> Block:
    rows = []
    for record in atlas.maps:
        for line in (line for line in record.agreement if line.verdict == "differs"):
            reason = expected_difference(line)
            where = blocks.link(f"#map-{record.id}", record.title) + (f": {line.layer}" if line.layer else "")
            ours, theirs = (
                along(line.reference, line.boundaries[0], record),
                along(line.lammps, line.boundaries[1], record),
            )
            why = f"{reason.finding or 'not a defect'}: {reason.why}" if reason else "none known"
            cells = [where, f"{record.y.name} = {line.y:.5g}", theirs, ours, why]
            rows.append(PageRow(cells, "" if reason else "open"))
    if not rows:
        return Paragraph("Nowhere: all boundaries agree within their uncertainty.")
    return PageTable(["map", "line", "LAMMPS", "reference", "finding"], rows, css="points wide-table")


def along(kinds: Sequence[model.Kind], boundaries: Sequence[model.Boundary], record: MapRecord) -> str:
    """Return the kinds along a line, in words."""
    changes = (f"{b.above} from {record.x.name} = {b.low:.4g} to {b.high:.4g} on" for b in boundaries)
    return ", ".join([kinds[0] if kinds else "nothing", *changes])


def _section(record: MapRecord, of: StabilityMap | None, folder: Path) -> PageSection:
    figure = draw.map_figure(record, of.theory if of else (), lambda cell: f"#{cell.anchor}")
    informative = informative_cells(record)
    decks = {cell: path for cell in informative if of and (path := write_deck(of, cell, folder))}
    edges = [
        PageRow(
            [
                *(b.layer, number(b.y, 5), WHO[b.engine], f"{number(b.low, 5)} to {number(b.high, 5)}"),
                *(_badge(b.below), _badge(b.above)),
            ],
            "theirs" if b.engine == "lammps" else "",
        )
        for b in record.boundaries
    ]
    cells = [_cell(cell, ends, record, folder, decks, informative) for cell, ends in outcomes(record).items()]
    x, y = f"#{record.x.name}", f"#{record.y.name}"
    return PageSection(
        f"map-{record.id}",
        record.title,
        [
            Paragraph(record.about, "about"),
            Picture(saved(figure, folder / "figures", record.id)),
            Details(f"boundaries ({len(edges)})", [PageTable(["layer", y, "engine", x, "below", "above"], edges)]),
            Details(
                f"cells ({len(cells)})",
                [
                    PageTable(
                        ["layer", x, y, "LAMMPS", "reference", "before the failure", "run again"],
                        cells,
                        css="points cells",
                    )
                ],
            ),
        ],
        "map",
    )


def outcomes(record: MapRecord) -> dict[MapCell, dict[Engine, CellOutcome]]:
    """Return how every cell ended on each engine, by layer, height and place."""
    found: dict[MapCell, dict[Engine, CellOutcome]] = {}
    for run in sorted(record.cells, key=lambda run: (record.layers.index(run.cell.layer), run.cell.y, run.cell.x)):
        found.setdefault(run.cell, {})[run.engine] = run.outcome
    return found


def informative_cells(record: MapRecord) -> set[MapCell]:
    """Return the cells that show a map: where a failure begins, and where the engines end differently."""
    severity = model.KINDS.index
    edges = {b.cell(b.high if severity(b.above) > severity(b.below) else b.low) for b in record.boundaries}
    return edges | {cell for cell, ends in outcomes(record).items() if _differ(ends)}


def _differ(ends: Mapping[Engine, CellOutcome]) -> bool:
    return len({outcome.kind for outcome in ends.values()}) > 1


def _cell(
    cell: MapCell,
    ends: Mapping[Engine, CellOutcome],
    record: MapRecord,
    folder: Path,
    decks: Mapping[MapCell, str],
    shown: Container[MapCell],
) -> PageRow:
    """Return the row of a cell; with the particles before a failure if it is among those shown."""
    states = {side: model.read_state(folder, cell, side) for side in WHO if cell in shown}
    thumbnails = Markup("").join(_shot(state, WHO[side]) for side, state in states.items() if state is not None)
    deck = Markup(" ") + blocks.link(decks[cell], "deck") if cell in decks else ""
    return PageRow(
        [
            *(cell.layer, number(cell.x, 5), number(cell.y, 5)),
            *(_outcome(ends.get("lammps")), _outcome(ends.get("reference"))),
            *(Markup('<div class="thumbs">{}</div>').format(thumbnails), blocks.code(cell.command) + deck),
        ],
        "differ" if _differ(ends) else "",
        cell.anchor,
    )


def _outcome(outcome: CellOutcome | None) -> Markup:
    if outcome is None:
        return Markup('<span class="none">not run here</span>')
    numbers = {
        f"step {outcome.step} of {outcome.steps}": outcome.step,
        f"atom {outcome.atom}": outcome.atom,
        f"value {number(outcome.value, 5)}": outcome.value,
    }
    where = ", ".join(text for text, given in numbers.items() if given is not None)
    parts = [Markup('<div class="where">{}</div>').format(where)] if where else []
    parts += [Markup('<div class="text">{}</div>').format(outcome.message)] if outcome.message else []
    return _badge(outcome.kind) + Markup("").join(parts)


def _shot(state: Mapping[str, Any], who: str) -> Markup:
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
    alt = f"particles of {who} after step {step}, colour: {colours}" + (f"; ringed: {ring}" if ring else "")
    image = Markup('<figure><img alt="{}" src="data:image/png;base64,{}"><figcaption>{}</figcaption></figure>')
    return image.format(alt, base64.b64encode(png).decode(), f"{who}, step {step}")


# --- a cell as a deck


def write_deck(of: StabilityMap, cell: MapCell, folder: Path) -> str:
    """Write the deck of a cell and its data file; return its path from the page, empty if none can express the cell."""
    start, watch = of.start(cell), of.watch(cell)
    scene = watched(start.case.scene, watch)
    note, data = (f"{of.title}: {cell.name}", cell.command), f"{cell.anchor}.data"
    try:
        text, particles = deck(replace(start, case=replace(start.case, scene=scene)), data, note, watch.every)
    except InputError:
        return ""
    path = f"decks/{cell.anchor}.in"
    write_atomically(folder / "decks" / data, particles)
    write_atomically(folder / path, text)
    return path


def deck(start: Start, data: str, note: Sequence[str] = (), every: int = 10) -> tuple[str, str]:
    """Return the deck that reproduces the engine's run from a start, bit for bit, and the content of its data file.

    Parameters
    ----------
    data : str
        Name of the data file.
    note : sequence of str
        Comments at the top.
    every : int
        Steps between two lines of thermo output, and two frames of the dump.

    Raises
    ------
    InputError
        A number of the start is not finite, which LAMMPS does not read.
    """
    of = job(start.case.scene, start.atoms, plan(start.case.scene))
    for name, values in {"x": of.x_nc, "v": of.v_nc, **of.per_atom}.items():
        if values is not None and not np.isfinite(values).all():
            raise InputError(name, "must be finite in a deck: LAMMPS reads no other number", "inf or nan")
    commands, particles = until_first_run(of, data)
    runs = (stretch.command for stretch in of.runs if isinstance(stretch, RunCommand))
    lines = [*(f"# {_plain(line)}" for line in note), *commands, "", *_output(of, every), "", *runs]
    return "\n".join(lines) + "\n", particles


def _plain(line: str) -> str:
    # LAMMPS joins a line that ends with & to the next one, in comments too, and to those within """.
    return " ".join(line.split()).translate({ord(c): None for c in '&"'}).encode("ascii", "replace").decode()


def _output(of: Job, every: int) -> Iterator[str]:
    """Yield thermo output and a dump: positions, velocities, density, what compute q of the job gives, by its names."""
    yield f"thermo {every}"
    yield "thermo_style custom step atoms ke"
    names = list(_columns(of.outputs))
    columns = {f"c_q[{k}]" if len(names) > 1 else "c_q": name for k, name in enumerate(names, 1)}
    if "rho" in of.atom_arrays and "rho" not in of.outputs:
        yield "compute density all rheo/property/atom rho"
        columns = {"c_density": "rho", **columns}
    yield f"dump frames all custom {every} frames.dump {' '.join(['id type x y z vx vy vz', *columns])}"
    named = " ".join(f"colname {column} {name}" for column, name in columns.items())
    yield f"dump_modify frames sort id format float %.17g {named}"  # all digits of a double


def _columns(outputs: Mapping[str, tuple[int, ...]]) -> Iterable[str]:
    for name, shape in outputs.items():
        count = math.prod(shape)
        yield from (name if count == 1 else f"{name}[{k + 1}]" for k in range(count))
