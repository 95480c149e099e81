"""A long campaign: thousands of cases in one run, in a process that monitors its resources.

Its cases are those of the laws that LAMMPS answers, pass by pass, each pass drawn again: a case's name is its seed.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean, median

from lammps_cases.comparison.store import open_store
from lammps_cases.engine import cluster, forkserver, installations
from lammps_cases.records.progress import Progress
from lammps_cases.records.run_record import read_run
from lammps_cases.run import campaign, prepared_case
from lammps_cases.scene import FromFile, casefile
from lammps_cases.scene.casefile import Case

SMALL = 1000  # particles
PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class Sample:
    """The campaign at a moment: cases judged, seconds since the first, those of this process' processor, its memory.

    ``workers`` have been started so far, the ``largest`` has so many bytes of memory, the ``store`` so many on disk.
    """

    cases: int
    wall: float
    processor: float
    memory: int
    workers: int
    largest: int
    store: int


class Watch(Progress):
    """Writes a sample after every pass to a file of lines; ``own`` processor seconds are not the campaign's."""

    def __init__(self, file: Path, every: int) -> None:
        self.file, self.every, self.begin, self.own = file, every, 0.0, 0.0

    def advance(self, done: int, total: int | None, label: str, complaint: str = "") -> None:
        """Take a sample, if it is time."""
        self.begin = self.begin or time.perf_counter()
        if complaint:
            print(complaint, file=sys.stderr, flush=True)
        if done % self.every == 0 or done == total:
            begin = time.process_time()
            sample = Sample(done, time.perf_counter() - self.begin, begin - self.own, memory(), *_left())
            with self.file.open("a") as lines:
                lines.write(json.dumps(asdict(sample)) + "\n")
            self.own += time.process_time() - begin


def memory(process: str = "self") -> int:
    """Return the bytes of memory that a process has now; 0 if it is gone."""
    try:
        return int(Path("/proc", process, "statm").read_text().split()[1]) * PAGE
    except OSError:
        return 0


def _left() -> tuple[int, int, int]:
    """Return how many workers have left a file, one each; the memory of the largest; the bytes in the store."""
    files = Path(os.environ["TMPDIR"]).glob("eos-ref-workers-*/*")
    workers = [file.name for file in files if file.name.isdigit()]
    return len(workers), max(map(memory, workers), default=0), open_store().size()[1]


def settings() -> list[Case]:
    """Return the cases of a pass: small ones that LAMMPS answers, which a campaign runs in the order given."""
    laws = casefile.select(casefile.load(), tag="eos")
    given = [case for case in laws if case.scene.expect is None and not isinstance(case.scene.positions, FromFile)]
    return [case for case in given if len(prepared_case.prepare(case).atoms) <= SMALL]


def drawn(of: Sequence[Case], count: int) -> list[Case]:
    """Return so many cases, pass by pass; a case of another name has other particles."""
    return [replace(of[k % len(of)], name=f"{of[k % len(of)].name}.{k // len(of):05d}") for k in range(count)]


def main(folder: Path, count: int, jobs: int, address: str = "") -> None:
    """Run a campaign, and print its peak memory."""
    forkserver.start_for_judging()
    of = settings()
    watch = Watch(folder / "samples", len(of))
    with cluster.used(address):
        engine, store = installations.resolve("env"), open_store()
        campaign.run_cases(drawn(of, count), engine, jobs, folder / "report", progress=watch, store=store, resume=False)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    ended = {"peak": peak, "wall": time.perf_counter() - watch.begin}
    (folder / "end.json").write_text(json.dumps(ended))


# --- what came of it


def samples(folder: Path) -> list[Sample]:
    """Return the samples of a campaign after its warm-up: from when the caches of the main process are full."""
    every = [Sample(**json.loads(line)) for line in (folder / "samples").read_text().splitlines()]
    return [sample for sample in every if sample.cases >= campaign.KEPT]


def growth(of: Sequence[Sample]) -> float:
    """Return the largest memory of the main process over the least."""
    return max(sample.memory for sample in of) / min(sample.memory for sample in of)


def slowing(folder: Path) -> float:
    """Return the cost of a case in the last quarter of the passes over that in the first.

    Costs are processor seconds, which other programs disturb less than wall-clock ones: for the workers the median
    over the passes of each case, so that a case is compared with itself and a disturbance for less than half of a
    quarter has no effect; for the main process the mean.
    """
    after = samples(folder)
    quarter = len(after) // 4
    early, late = after[: quarter + 1], after[-quarter - 1 :]
    return _cost(folder, late) / _cost(folder, early)


def _cost(folder: Path, of: Sequence[Sample]) -> float:
    first, last = of[0], of[-1]
    size = len(settings())
    passes = {f"{k:05d}" for k in range(first.cases // size, last.cases // size)}
    seconds: dict[str, list[float]] = {}
    for case in read_run(folder / "report").cases:
        name, _, number = case.case.rpartition(".")
        if number in passes:
            seconds.setdefault(name, []).append(sum(case.seconds.stages.values()))
    main = (last.processor - first.processor) / (last.cases - first.cases)
    return fmean(map(median, seconds.values())) + main


OPENS = """<!doctype html><body><script>
const begin = performance.now(), frame = document.createElement("iframe");
frame.width = 1280;
frame.height = 900;
frame.onload = () => (document.title = frame.contentDocument.body.offsetHeight && performance.now() - begin);
frame.src = "report.html";
document.body.append(frame);
</script>
"""


def opening(report: Path, profile: Path) -> float:
    """Return the seconds until chromium has loaded and laid out a report, without those of its start."""
    (report / "opens.html").write_text(OPENS)
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
    options += ["--allow-file-access-from-files", f"--user-data-dir={profile}", "--dump-dom"]
    page = (report / "opens.html").as_uri()
    done = subprocess.run(["chromium", *options, page], capture_output=True, text=True, timeout=120, check=True)
    (report / "opens.html").unlink()
    found = re.search(r"<title>([\d.]+)</title>", done.stdout)
    assert found, done.stdout
    return float(found[1]) / 1000


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:4]), *sys.argv[4:])
