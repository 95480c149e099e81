"""docs/capacity.md from what was measured: ``python -m lammps_cases.studies.capacity.summary [SOAK COMPUTED STORED]``.

The folders are that of `make soak` (SOAK_OUT), and of two runs of all cases, with predictions computed and stored;
``particles`` in their place measures the costs of a particle alone.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from lammps_cases.history import store as history
from lammps_cases.records.documents import LARGEST
from lammps_cases.records.files import write_atomically
from lammps_cases.records.wording import number
from lammps_cases.studies.capacity.costs import DOCUMENT, CampaignCosts, SimulatedCampaign, measured, scenes
from lammps_cases.studies.capacity.simulation import on_paper, simulated

MEASURED = Path(__file__).parent / "measured.json"
BEGIN, END = "<!-- computed:begin -->", "<!-- computed:end -->"
MANY, CORES, NODE = 1_000_000, 64, 256e9  # cases; of a node: workers, bytes of memory
PLANS = ((10_000, 4, 16), (MANY, 16, CORES), (MANY, 256, CORES), (MANY, 1, 256 * CORES))
PARTICLES = "particles"
KINDS = ("computed", "stored")
GB, HOUR, ATOMS = 1e9, 3600.0, 1_000_000_000


def table(costs: CampaignCosts) -> str:
    """Return the costs, the campaigns and the particles as Markdown."""
    lines = ["| measured, per case | |", "|---|---|", *_costs(costs), ""]
    lines += [
        "| cases | shards | workers of each | predictions | hours, on paper | hours, simulated | busy workers |",
        "|---|---|---|---|---|---|---|",
        *(_plan(costs, plan) for plan in costs.simulated),
        "",
        f"| {MANY:,} cases | |",
        "|---|---|",
        *_whole(costs),
        "",
        "| particles of a scene | seconds of LAMMPS | seconds of the judge | GB at most |",
        "|---|---|---|---|",
        *(_row(f"{j.particles:,}", n(j.lammps), n(j.judge), n(j.memory / GB)) for j in costs.judged),
        "",
        "| particles | |",
        "|---|---|",
        *_particles(costs),
    ]
    return "\n".join(lines)


def _costs(costs: CampaignCosts) -> Iterator[str]:
    means = " / ".join(f"{n(costs.mean(kind))} s" for kind in KINDS)
    yield _row("worker, predictions computed / stored, on average", means)
    yield _row("the longest", " / ".join(f"{n(costs.worker[kind][-1])} s" for kind in KINDS))
    yield _row(
        "main process, while cases are judged / merge, with its report", f"{n(costs.main)} s / {n(costs.merge)} s"
    )
    yield _row(
        "memory of the main process, while judged / for the report", f"{costs.held:.0f} B / {costs.record:.0f} B"
    )
    yield _row(
        "arrays / run.json / history", " / ".join(f"{b:.0f} B" for b in (costs.arrays, costs.text, costs.history))
    )


def _plan(costs: CampaignCosts, plan: SimulatedCampaign) -> str:
    paper = on_paper(costs, plan)
    busy = costs.mean(plan.predictions) * plan.cases / (plan.shards * plan.workers * plan.seconds)
    hours = (n(seconds / HOUR) for seconds in (paper, plan.seconds))
    return _row(f"{plan.cases:,}", str(plan.shards), str(plan.workers), plan.predictions, *hours, f"{busy:.0%}")


def _whole(costs: CampaignCosts) -> Iterator[str]:
    most = int(LARGEST / costs.text)
    yield _row("main process while cases are judged, at the end", f"{n((costs.base + MANY * costs.held) / GB)} GB")
    yield _row("the same with every record in memory", f"{n(MANY * costs.record / GB)} GB")
    yield _row("files of arrays, bytes", f"{MANY:,}, {n(MANY * costs.arrays / GB)} GB")
    yield _row("one merge, with its report", f"{n(MANY * costs.merge / HOUR)} h")
    yield _row("cases of one report: what is read of a run.json", f"{most:,}")
    yield _row(
        "reports of 20,000 cases: number, memory for each", f"{MANY // 20_000}, {n(20_000 * costs.record / GB)} GB"
    )
    yield _row("workers that one main process keeps busy, computed / stored", _kept_busy(costs))


def _kept_busy(costs: CampaignCosts) -> str:
    return " / ".join(f"{costs.mean(kind) / costs.main:.0f}" for kind in KINDS)


def _particles(costs: CampaignCosts) -> Iterator[str]:
    before, last = costs.judged[-2:]
    more = last.particles - before.particles
    memory, judge = (last.memory - before.memory) / more, (last.judge - before.judge) / more
    million = last.memory + (1_000_000 - last.particles) * memory
    hours, at_once = ATOMS * judge / (16 * CORES) / HOUR, CORES * million / GB
    yield _row("of a further particle: the judge / memory", f"{n(judge * 1e6)} µs / {memory:.0f} B")
    yield _row(
        f"{ATOMS:,} in scenes of a million, 16 nodes of {CORES} workers", f"{n(hours)} h, {n(at_once)} GB a node"
    )
    yield _row("the same in one scene: memory", f"{n(ATOMS * memory / GB)} GB")
    yield _row(f"the largest scene in {n(NODE / GB)} GB", f"{n(NODE / memory / 1e6)} million particles")


def n(value: float) -> str:
    """Return a number with two digits."""
    return f"{value:,.0f}" if value >= 100 else number(float(value), 2)


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def document(text: str, costs: CampaignCosts) -> str:
    """Return a document with the tables in their place."""
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n{table(costs)}\n{END}{rest.split(END)[1]}"


def main(folders: Sequence[str]) -> None:
    """Measure and simulate, if there is anything new, and write the tables."""
    if folders == [PARTICLES]:
        costs = replace(DOCUMENT.read(MEASURED), judged=scenes())
        DOCUMENT.write(MEASURED, costs)
    elif folders:
        soak, computed, stored = map(Path, folders)
        os.environ[history.VARIABLE] = history.OFF  # what is merged to be timed is no run
        with tempfile.TemporaryDirectory() as scratch:
            costs = measured(soak, {"computed": computed, "stored": stored}, Path(scratch))
        DOCUMENT.write(MEASURED, costs)
    costs = DOCUMENT.read(MEASURED)
    if len(folders) > 1 or not costs.simulated:
        costs = replace(costs, simulated=tuple(simulated(costs, *plan, kind) for kind in KINDS for plan in PLANS))
        DOCUMENT.write(MEASURED, costs)
    path = Path(__file__).parents[3] / "docs" / "capacity.md"
    write_atomically(path, document(path.read_text(encoding="utf-8"), costs))


if __name__ == "__main__":
    main(sys.argv[1:])
