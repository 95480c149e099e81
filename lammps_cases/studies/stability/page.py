"""The page of an atlas: every map with its pictures, every cell with its numbers and the command to run it."""

from __future__ import annotations

import base64
import math
from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from eos_ref import InputError
from eos_ref.eos.table import FloatArray
from lammps_cases.engine.session import Job, RunCommand
from lammps_cases.records.files import write_atomically
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.figures import saved
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.flows.flow import Start
from lammps_cases.studies.stability import draw, model
from lammps_cases.studies.stability.maps import expected_difference, unexplained
from lammps_cases.studies.stability.model import (
    Atlas,
    CellOutcome,
    Engine,
    Kind,
    MapCell,
    MapRecord,
    StabilityMap,
    read_state,
)
from lammps_cases.studies.stability.runs import watched

ASSETS = Path(__file__).parent / "assets"


@dataclass(frozen=True)
class Shot:
    """A picture of particles: its data as an address, and its caption."""

    data: str
    caption: str
    alt: str


WHO: dict[Engine, str] = {"lammps": "LAMMPS", "reference": "reference"}


@dataclass(frozen=True)
class CellView:
    """A cell on the page: how it ended on each engine, the path of its deck, its particles."""

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
    """A map on the page."""

    record: MapRecord
    picture: Markup
    rows: list[CellView]

    @property
    def kinds(self) -> dict[Kind, tuple[int, int]]:
        """Number of runs ended by each kind, on LAMMPS and on the reference."""
        ends = Counter((run.engine, run.outcome.kind) for run in self.record.cells)
        counts: dict[Kind, tuple[int, int]] = {k: (ends["lammps", k], ends["reference", k]) for k in model.KINDS}
        return {kind: count for kind, count in counts.items() if any(count)}

    @property
    def agreement(self) -> str:
        """Number of lines on which the engines agree."""
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
        "bad" if unexplained(atlas.disagreements) else "good",
        scripts=[frame.FILTER],
        atlas=atlas,
        colours={kind: colour for kind, (colour, _) in draw.MARKS.items()},
        facts=atlas.facts,
        maps=[_map(record, maps.get(record.id), folder) for record in atlas.maps],
        disagreements=[
            (record, line, expected_difference(line))
            for record in atlas.maps
            for line in record.agreement
            if line.verdict == "differs"
        ],
        along=along,
    )
    write_atomically(folder / "report.html", html)


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
    """Write the deck of a cell; return its path from the page, empty if no deck can express it."""
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


# --- a cell as a deck; numbers are written as the shortest text that reads back as the same double

# Keyword of LAMMPS' command set for each per-atom array of a job.
_SET = {"rho": "rheo/rho", "esph": "sph/e"}


def deck(start: Start, note: Sequence[str] = (), every: int = 10) -> str:
    """Return the deck that reproduces the engine's run from a start, bit for bit, with thermo output and a dump.

    Parameters
    ----------
    note : sequence of str
        Comments at the top.
    every : int
        Steps between two lines of thermo output, and two frames of the dump.

    Raises
    ------
    InputError
        A start that no deck can express: ids other than 1 to N, or a number that is not finite.
    """
    deck_job = job(start.case.scene, start.atoms, plan(start.case.scene))
    _check(deck_job)
    lines = [
        *(f"# {_plain(line)}" for line in note),
        *deck_job.setup,
        "",
        *_atoms(deck_job),
        "",
        *deck_job.commands,
        "",
        *_output(deck_job, every),
        "",
        *(stretch.command for stretch in deck_job.runs if isinstance(stretch, RunCommand)),
    ]
    return "\n".join(lines) + "\n"


def _plain(line: str) -> str:
    # LAMMPS joins a line that ends with & to the next one, in comments too, and to those within """.
    return " ".join(line.split()).translate({ord(c): None for c in '&"'}).encode("ascii", "replace").decode()


def _check(deck_job: Job) -> None:
    if not np.array_equal(deck_job.id_n, np.arange(1, len(deck_job.id_n) + 1)):
        raise InputError(
            "ids", "must be 1 to N in a deck: LAMMPS numbers the atoms that it creates", int(deck_job.id_n[0])
        )
    for name, values in {"x": deck_job.x_nc, "v": deck_job.v_nc, **deck_job.per_atom}.items():
        if values is not None and not np.isfinite(values).all():
            raise InputError(name, "must be finite in a deck: LAMMPS reads no other number", "inf or nan")


def _atoms(deck_job: Job) -> Iterable[str]:
    """Yield atoms in the order of their ids, and their properties; those shared by all are set once."""
    for t, (x, y, z) in zip(deck_job.type_n.tolist(), deck_job.x_nc.tolist(), strict=True):
        # With remap an atom on the upper face of a periodic box is not left out.
        yield f"create_atoms {t} single {x!r} {y!r} {z!r} remap yes"
    given: dict[str, FloatArray] = {}
    if deck_job.v_nc is not None:
        given |= {f"v{axis}": deck_job.v_nc[:, k] for k, axis in enumerate("xyz")}
    given |= {_SET[name]: np.asarray(values_n, float) for name, values_n in deck_job.per_atom.items()}
    # A signed zero is set atom by atom.
    shared = {
        name
        for name, values_n in given.items()
        if np.unique(values_n).size == 1 and not (np.signbit(values_n) & (values_n == 0.0)).any()
    }
    for name in sorted(shared):
        if given[name][0] != 0.0 or not name.startswith("v"):
            yield f"set group all {name} {float(given[name][0])!r}"
    own = {name: values_n.tolist() for name, values_n in given.items() if name not in shared}
    for k in range(len(deck_job.id_n) if own else 0):
        yield f"set atom {k + 1} " + " ".join(f"{name} {values[k]!r}" for name, values in own.items())


def _output(deck_job: Job, every: int) -> Iterable[str]:
    """Yield thermo output and a dump: positions, velocities, density, what compute q of the job gives."""
    yield f"thermo {every}"
    yield "thermo_style custom step atoms ke"
    columns = ["id", "type", "x", "y", "z", "vx", "vy", "vz"]
    names: dict[str, str] = {}
    if "rho" in deck_job.atom_arrays and "rho" not in deck_job.outputs:
        yield "compute density all rheo/property/atom rho"
        names["c_density"] = "rho"
    single = sum(math.prod(shape) for shape in deck_job.outputs.values()) == 1
    place = 0
    for name, shape in deck_job.outputs.items():
        for k in range(math.prod(shape)):
            place += 1
            label = name if math.prod(shape) == 1 else f"{name}[{k + 1}]"
            names["c_q" if single else f"c_q[{place}]"] = label
    yield f"dump frames all custom {every} frames.dump {' '.join([*columns, *names])}"
    # All digits of a double.
    yield "dump_modify frames sort id format float %.17g " + " ".join(
        f"colname {column} {label}" for column, label in names.items()
    )
