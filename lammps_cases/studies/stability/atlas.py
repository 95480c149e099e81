"""The atlas: boundaries of all maps on both engines, bisected in parallel, taken up again where it was left."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import asdict, dataclass, field
from pathlib import Path

from lammps_cases.comparison import prediction_keys
from lammps_cases.engine.installations import library_sha256
from lammps_cases.engine.workers import Workers
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.studies.benchmarks.measure import machine
from lammps_cases.studies.stability import probe, record
from lammps_cases.studies.stability.lines import Agreement, MapLine, agreement, boundaries, lines_of, wanted
from lammps_cases.studies.stability.model import ENGINES, Boundary, CellRun, Engine, Kind, MapCell, StabilityMap
from lammps_cases.studies.stability.probe import Examined, PendingCell
from lammps_cases.studies.stability.record import Atlas, CellEntry, MapRecord

JOBS = 2
# Sources, beside the reference, that decide how a cell ends: between a start and what is seen of it.
SOURCES = (
    *("setup/commands.py", "engine/session.py", "setup/plan.py", "setup/reference_side.py"),
    *(
        "studies/stability/kinds.py",
        "studies/stability/probe.py",
        "studies/stability/runs.py",
        "studies/stability/single.py",
    ),
)


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
    """Run maps, and write the atlas; cells that the folder has are not run again.

    Parameters
    ----------
    maps : sequence of StabilityMap
    out : Path
        Folder: ``cells.jsonl`` grows with every cell, ``atlas.json`` and ``cells.csv`` are written at the end.
    command : str
        Said in the atlas.
    quick : bool
        Only the quick lines of the maps.
    engines : sequence of {"reference", "lammps"}
    site : str, optional
        Folder of another LAMMPS, see `lammps_cases.engine.installations`.
    jobs : int
        Worker processes.
    limit : float
        Seconds after which a cell hangs.
    progress : Progress
        Is told of every cell.

    Raises
    ------
    EngineMissing
    InputError
        A map whose scene cannot be made.
    """
    begin, before = time.perf_counter(), machine()
    out.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        folder, workers = stack.enter_context(probe.scratch()), stack.enter_context(Workers(site, jobs))
        about = workers.identify().result()
        about = {k: v for k, v in about.items() if k != "library"} | {
            "library_sha256": library_sha256(about.get("library", ""))
        }
        source = CellSource(workers, folder, limit, about)
        lines = [
            MapLine(m.id, layer, y, e)
            for m in maps
            for layer in m.layers
            for y in lines_of(m, quick)
            for e in engines
            if e in m.engines(layer)
        ]
        results = Survey({m.id: m for m in maps}, lines, source, out, progress).run(2 * jobs)
    records = tuple(map_record(m, quick, results, engines) for m in maps)
    atlas = Atlas(command, before, about, quick, time.perf_counter() - begin, records)
    record.write(atlas, out)
    return atlas


class CellSource:
    """Where cells come from: workers that examine them."""

    def __init__(self, workers: Workers, folder: Path, limit: float, about: dict[str, str]) -> None:
        self.workers, self.folder, self.limit = workers, folder, limit
        self.identity: dict[Engine, str] = {"reference": "", "lammps": repr(sorted(about.items()))}

    def ask(self, of: StabilityMap, cell: MapCell, side: Engine) -> PendingCell:
        """Queue a cell."""
        return probe.ask(of, cell, side, self.workers, self.folder, self.limit)

    def settle(self, pending: PendingCell) -> Examined:
        """Wait for a cell."""
        return probe.settle(pending, self.workers, self.limit)

    def key(self, of: StabilityMap, cell: MapCell, side: Engine) -> str:
        """Hash all that a cell's end depends on: start, watch, sources, engine, and the time it may take."""
        start, watch = of.start(cell), of.watch(cell)
        a = start.atoms
        arrays = (a.id_n, a.type_n, a.x_nc, a.v_nc, a.rho_n, a.energy_n, a.mass_n, a.low_c, a.high_c)
        problem = start.case.scene.model_dump_json(), repr(asdict(watch)), start.steps, start.timestep
        return prediction_keys.fingerprint(
            asdict_text(cell), side, self.identity[side], sources(), self.limit, problem, arrays
        )


def asdict_text(cell: MapCell) -> str:
    """Return a cell as text."""
    return repr(sorted(asdict(cell).items()))


@functools.cache
def sources() -> str:
    """Hash the code that decides how a cell ends, with the reference, its libraries and the processor."""
    digest = hashlib.sha256(prediction_keys.context().encode())
    package = Path(__file__).parents[2]
    for path in [*(package / name for name in SOURCES), *sorted((package / "scene").glob("*.py"))]:
        digest.update(path.read_bytes())
    return digest.hexdigest()


@dataclass
class _Open:
    """A line that is being bisected."""

    line: MapLine
    runs: dict[float, CellRun] = field(default_factory=dict)
    pending: dict[float, tuple[str, PendingCell]] = field(default_factory=dict)

    @property
    def kinds(self) -> dict[float, Kind]:
        return {x: ran.outcome.kind for x, ran in self.runs.items()}


class Survey:
    """Lines that are bisected side by side."""

    def __init__(
        self, maps: dict[str, StabilityMap], lines: Sequence[MapLine], source: CellSource, out: Path, progress: Progress
    ) -> None:
        self.maps, self.lines, self.source, self.out, self.progress = maps, lines, source, out, progress
        self.kept = {one.key: one.ran for one in record.cells(out).entries()}
        self.results: dict[MapLine, dict[float, CellRun]] = {}

    def run(self, at_once: int) -> dict[MapLine, dict[float, CellRun]]:
        """Run the cells of all lines, ``at_once`` lines at a time; the result does not depend on which ends first."""
        waiting, opened = list(reversed(self.lines)), list[_Open]()
        while waiting or opened:
            while waiting and len(opened) < at_once:
                opened.append(_Open(waiting.pop()))
                self._advance(opened[-1])
            opened = [one for one in opened if not self._done(one)]
            if opened and (len(opened) >= at_once or not waiting):
                self._collect(opened)
        return self.results

    def _done(self, one: _Open) -> bool:
        if one.pending:
            return False
        self.results[one.line] = {x: one.runs[x] for x in sorted(one.runs)}
        return True

    def _advance(self, one: _Open) -> None:
        """Ask for the next places of a line, as long as they are at hand."""
        of, line = self.maps[one.line.map], one.line
        while not one.pending and (places := wanted(of, one.kinds)):
            for x in places:
                cell = MapCell(line.map, x, line.y, line.layer)
                key = self.source.key(of, cell, line.engine)
                if key in self.kept:
                    one.runs[x] = self.kept[key]
                    self._report(line)
                else:
                    one.pending[x] = key, self.source.ask(of, cell, line.engine)

    def _collect(self, opened: Iterable[_Open]) -> None:
        """Wait for a cell, and take in all that have come."""
        futures: set[Future[Examined]] = {pending.future for one in opened for _, pending in one.pending.values()}
        wait(futures, return_when=FIRST_COMPLETED)
        for one in opened:
            for x, (key, pending) in list(one.pending.items()):
                if pending.future.done():
                    del one.pending[x]
                    one.runs[x] = self._take(one.line, x, key, self.source.settle(pending))
            self._advance(one)

    def _take(self, line: MapLine, x: float, key: str, examined: Examined) -> CellRun:
        cell = MapCell(line.map, x, line.y, line.layer)
        ran = CellRun(cell, line.engine, examined.outcome)
        record.write_state(self.out, cell, line.engine, examined.before)
        record.cells(self.out).append(CellEntry(key, ran))
        self._report(line)
        return ran

    def _report(self, line: MapLine) -> None:
        self.progress.advance(len(self.results), len(self.lines), f"lines: {line.map} {line.layer}")


def map_record(
    of: StabilityMap, quick: bool, results: dict[MapLine, dict[float, CellRun]], engines: Sequence[Engine]
) -> MapRecord:
    """Return the results of a map, in the order of its layers and lines."""
    cells: list[CellRun] = []
    edges, agreements = list[Boundary](), list[Agreement]()
    for layer in of.layers:
        for y in lines_of(of, quick):
            kinds: dict[Engine, dict[float, Kind]] = {}
            for engine in (e for e in engines if e in of.engines(layer)):
                line = MapLine(of.id, layer, y, engine)
                cells += results[line].values()
                kinds[engine] = {x: ran.outcome.kind for x, ran in results[line].items()}
                edges += boundaries(line, kinds[engine])
            if "reference" in kinds and "lammps" in kinds:
                agreements.append(agreement(of, layer, y, kinds["reference"], kinds["lammps"]))
    seconds = sum(ran.outcome.seconds for ran in cells)
    head = of.id, of.title, of.about, of.x, of.y, of.layers, tuple(lines_of(of, quick))
    return MapRecord(*head, seconds, tuple(cells), tuple(edges), tuple(agreements))
