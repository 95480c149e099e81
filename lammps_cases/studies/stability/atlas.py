"""The atlas: boundaries of all maps on both engines, bisected in parallel and resumable."""

from __future__ import annotations

import functools
import hashlib
import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from lammps_cases.comparison import store
from lammps_cases.engine.installations import library_sha256
from lammps_cases.engine.workers import Workers
from lammps_cases.records.journal import Parts
from lammps_cases.records.measure import machine
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.studies.stability import model, probe
from lammps_cases.studies.stability.model import (
    ENGINES,
    Agreement,
    Atlas,
    Axis,
    Boundary,
    CellRun,
    Engine,
    Kind,
    MapCell,
    MapLine,
    MapRecord,
    StabilityMap,
)
from lammps_cases.studies.stability.probe import Examiner

JOBS = 2
# Sources, in addition to the reference, that determine how a cell ends, from start to observation.
SOURCES = (
    *("setup/commands.py", "engine/session.py", "engine/reading.py", "setup/plan.py", "setup/reference_side.py"),
    "studies/flows/solve.py",
    *(f"studies/stability/{name}.py" for name in ("kinds", "probe", "runs")),
)
Key = Callable[[StabilityMap, MapCell, Engine], str]
Results = dict[MapLine, dict[float, CellRun]]


def measure(
    maps: Sequence[StabilityMap],
    out: Path,
    command: str = "",
    *,
    quick: bool = False,
    engines: Sequence[Engine] = ENGINES,
    site: str | None = None,
    jobs: int = JOBS,
    limit: float = probe.LIMIT,
    progress: Progress = SILENT,
) -> Atlas:
    """Run maps, and write the atlas; cells in the folder are not run again.

    Parameters
    ----------
    maps : sequence of StabilityMap
    out : Path
        Folder: ``cells.jsonl`` grows with every cell, ``atlas.json`` and ``cells.csv`` are written at the end.
    command : str
        Command recorded in the atlas.
    quick : bool
        Whether only the quick lines of the maps are run.
    engines : sequence of {"reference", "lammps"}
    site : str, optional
        Folder of another LAMMPS, see `lammps_cases.engine.installations`.
    jobs : int
        Worker processes.
    limit : float
        Seconds after which a cell counts as hanging.
    progress : Progress
        Advances with every cell.

    Raises
    ------
    EngineMissing
    InputError
        The scene of a map cannot be made.
    """
    begin, before = time.perf_counter(), machine()
    out.mkdir(parents=True, exist_ok=True)
    kept, results, by_id = model.cells(out), Results(), {of.id: of for of in maps}
    # A thread for each of some lines; if interrupted, the workers end first, and the threads with them.
    with ThreadPoolExecutor(2 * jobs) as threads, Workers(site, jobs) as workers, probe.examiner(workers, limit) as one:
        about = workers.identify().result()
        about["library_sha256"] = library_sha256(about.pop("library", ""))
        key = functools.partial(cell_key, about=about, limit=limit)
        lines = _lines(maps, engines, quick)
        runs = threads.map(lambda line: bisected(by_id[line.map], line, one, key, kept, out), lines)
        for k, line in enumerate(lines):
            progress.advance(k, len(lines), f"lines: {line.map} {line.layer}")
            results[line] = next(runs)
    records = tuple(map_record(of, quick, results, engines) for of in maps)
    seconds = time.perf_counter() - begin + kept.earlier
    atlas = Atlas(command, before, about, quick, seconds, records)
    model.write(atlas, out)
    return atlas


def _lines(maps: Sequence[StabilityMap], engines: Sequence[Engine], quick: bool) -> list[MapLine]:
    """Return the lines of maps that are run, each on every engine."""
    return [
        MapLine(of.id, layer, y, engine)
        for of in maps
        for layer in of.layers
        for y in of.lines_run(quick)
        for engine in engines
    ]


def cell_key(of: StabilityMap, cell: MapCell, side: Engine, *, about: dict[str, str], limit: float) -> str:
    """Hash all that a cell's end depends on: start, watch, sources, LAMMPS' description, and the time limit."""
    start, watch = of.start(cell), of.watch(cell)
    a = start.atoms
    arrays = (a.id_n, a.type_n, a.x_nc, a.v_nc, a.rho_n, a.energy_n, a.mass_n, a.low_c, a.high_c)
    problem = start.case.scene.model_dump_json(), repr(asdict(watch)), start.steps, start.timestep
    identity = repr(sorted(about.items())) if side == "lammps" else ""
    return store.fingerprint(repr(cell), side, identity, sources(), limit, problem, arrays)


@functools.cache
def sources() -> str:
    """Hash the code that determines how a cell ends, with the reference, its libraries and the processor."""
    digest = hashlib.sha256(store.context().encode())
    package = Path(__file__).parents[2]
    for path in [*(package / name for name in SOURCES), *sorted((package / "scene").glob("*.py"))]:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def bisected(
    of: StabilityMap, line: MapLine, examiner: Examiner, key: Key, kept: Parts[CellRun], out: Path
) -> dict[float, CellRun]:
    """Return the cells of a line by x: the coarse ones, and those that locate its boundaries.

    Parameters
    ----------
    examiner : Examiner
        Runs cells.
    key : callable
        Makes the key of a cell; cells whose key is kept are not run.
    kept : Parts
        The journal of cells, which grows with every one.
    out : Path
        Folder of the atlas, for the particles before failures.
    """
    runs: dict[float, CellRun] = {}
    while places := wanted(of, _kinds(runs)):
        pending = {}
        for x in places:
            cell = line.cell(x)
            hashed = key(of, cell, line.engine)
            if (ran := kept.get(hashed)) is not None:
                runs[x] = ran
            else:
                pending[x] = hashed, cell, examiner.ask(of, cell, line.engine)
        for x, (hashed, cell, asked) in pending.items():
            examined = examiner.settle(asked)
            model.write_state(out, cell, line.engine, examined.before)
            runs[x] = kept.add(hashed, CellRun(cell, line.engine, examined.outcome))
    return runs


def _kinds(runs: Mapping[float, CellRun]) -> dict[float, Kind]:
    return {x: run.outcome.kind for x, run in sorted(runs.items())}


def map_record(of: StabilityMap, quick: bool, results: Results, engines: Sequence[Engine]) -> MapRecord:
    """Return the results of a map, in the order of its layers and lines."""
    cells, edges, agreements = list[CellRun](), list[Boundary](), list[Agreement]()
    for layer in of.layers:
        for y in of.lines_run(quick):
            ends: dict[Engine, dict[float, Kind]] = {}
            for engine in engines:
                line = MapLine(of.id, layer, y, engine)
                ends[engine] = _kinds(results[line])
                cells += [results[line][x] for x in ends[engine]]
                edges += boundaries(line, ends[engine])
            if "reference" in ends and "lammps" in ends:
                agreements.append(agreement(of, layer, y, ends["reference"], ends["lammps"]))
    seconds = sum(run.outcome.seconds for run in cells)
    head = of.id, of.title, of.about, of.x, of.y, of.layers, of.lines_run(quick)
    return MapRecord(*head, seconds, tuple(cells), tuple(edges), tuple(agreements))


# --- one line: the places that are run, changes of kind, agreement of two engines

Ends = Mapping[float, Kind]  # of the cells of a line, by x


def places(axis: Axis, coarse: int) -> list[float]:
    """Return the coarse places, evenly along the axis; the ends are exact."""
    if coarse < 2 or axis.low == axis.high:
        return [axis.low]
    low, high = axis.coordinate(axis.low), axis.coordinate(axis.high)
    inner = [low + (high - low) * k / (coarse - 1) for k in range(1, coarse - 1)]
    return [axis.low, *(10**u if axis.log else u for u in inner), axis.high]


def wanted(of: StabilityMap, ends: Ends) -> list[float]:
    """Return the places to run next: the coarse ones, then those between neighbours of different kind, then none."""
    missing = [x for x in places(of.x, of.coarse) if x not in ends]
    if missing:
        return missing
    return [
        of.x.middle(a, b)
        for a, b in itertools.pairwise(sorted(ends))
        if ends[a] != ends[b] and of.x.coordinate(b) - of.x.coordinate(a) > of.x.width
    ]


def boundaries(line: MapLine, ends: Ends) -> tuple[Boundary, ...]:
    """Return every change of kind along a line, from low to high."""
    return tuple(
        Boundary(line.map, line.layer, line.y, line.engine, a, b, ends[a], ends[b])
        for a, b in itertools.pairwise(sorted(ends))
        if ends[a] != ends[b]
    )


def sequence(ends: Ends) -> tuple[Kind, ...]:
    """Return the kinds along a line, each stretch of one kind once."""
    return tuple(kind for kind, _ in itertools.groupby(ends[x] for x in sorted(ends)))


def agreement(of: StabilityMap, layer: str, y: float, reference: Ends, lammps: Ends) -> Agreement:
    """Return the verdict on a line that both engines have run."""
    ours = boundaries(MapLine(of.id, layer, y, "reference"), reference)
    theirs = boundaries(MapLine(of.id, layer, y, "lammps"), lammps)
    kinds = sequence(reference), sequence(lammps)
    same = kinds[0] == kinds[1] and all(
        # Neighbouring intervals of bisection share an end up to rounding.
        of.x.coordinate(max(a.low, b.low)) - of.x.coordinate(min(a.high, b.high)) <= of.x.width
        for a, b in zip(ours, theirs, strict=True)
    )
    return Agreement(of.id, layer, y, "same" if same else "differs", *kinds, (ours, theirs))
