"""eos-ref bench."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lammps_cases.cli.shared import json_option

if TYPE_CHECKING:
    from lammps_cases.records.measure import ConfidenceInterval
    from lammps_cases.studies.chart.bench import Ratio

PARTS = ("laws", "model", "peers", "runs")


@click.command("bench")
@click.argument("parts", nargs=-1, type=click.Choice(PARTS))
@click.option("--states", type=click.IntRange(1000), default=10_000_000, show_default=True, help="States per law.")
@click.option("--repeats", type=click.IntRange(1), default=9, show_default=True, help="Measurements of each side.")
@click.option("--pysph", metavar="PYTHON", help="A Python with PySPH: one more peer.")
@click.option(
    "--history",
    type=click.Path(path_type=Path),
    default="reports/bench.jsonl",
    show_default=True,
    help="File in which every measurement is stored.",
)
@click.option("--label", default="", help="A name by which --compare finds this measurement.")
@click.option("--compare", nargs=2, metavar="A B", help="Measure nothing: compare two stored measurements.")
@json_option
def bench_command(
    parts: tuple[str, ...],
    states: int,
    repeats: int,
    pysph: str | None,
    history: Path,
    label: str,
    compare: tuple[str, str] | None,
    as_json: bool,
) -> int:
    """Measure speed relative to peers in one run, as ratios ours/peer, alternating with each of them.

    PARTS: laws (equations of state against memory copies), model (time steps against LAMMPS' own, one core each), peers
    (Taylor-Green vortices against LAMMPS on 1 and 2 ranks, and PySPH), runs (whole programs). All by default; the model
    takes some minutes. Fewer than 6 repeats give no 95 % interval.

    \b
    Example:  eos-ref bench laws --states 1000000 --label before
              eos-ref bench --compare before -1
    """
    if compare:
        return _compare(history, compare, as_json)
    from lammps_cases.studies.chart import bench, speed_history

    ratios: list[Ratio] = []
    memory: dict[str, float] = {}
    for part in parts or PARTS:
        for ratio in bench.measured(part, states, repeats, pysph):
            ratios.append(ratio)
            if not as_json:
                _show(ratio)
        memory |= _memory(part)
    speed_history.append(history, label, ratios)
    if as_json:
        click.echo(json.dumps({"ratios": [_row(r) for r in ratios], "bytes_per_particle": memory}, indent=1))
        return 0
    for what, size in memory.items():
        click.echo(f"peak memory, a million particles, {what}: {size:.0f} bytes per particle")
    click.echo(f"kept: {history}")
    return 0


def _row(r: Ratio) -> dict[str, object]:
    times = {"scene": r.scene, "peer": r.peer, "ours_ns": r.ours_ns.median, "peer_ns": r.peer_ns.median}
    return times | {"ratio": r.ratio.median, "ratio_low": r.ratio.low, "ratio_high": r.ratio.high}


def _compare(history: Path, names: tuple[str, str], as_json: bool) -> int:
    from dataclasses import asdict

    from lammps_cases.studies.chart import speed_history

    entries = speed_history.read(history)
    before, after = (speed_history.pick(entries, name, history) for name in names)
    changes = speed_history.changes(before, after)
    if as_json:
        click.echo(json.dumps({"changes": [asdict(change) for change in changes]}, indent=1))
        return 0
    colours = {"faster": "green", "slower": "red", "cannot tell": None}
    for change in changes:
        factor = f"x {change.factor.median:.2f} ({change.factor.low:.2f} to {change.factor.high:.2f})"
        line = f"{change.scene:44s} {change.peer:22s} {factor:26s} {change.answer}"
        click.secho(line, fg=colours[change.answer])
    click.echo(f"{len(changes)} ratios in both measurements; a factor below 1 is faster")
    return 0


def _memory(part: str) -> dict[str, float]:
    from lammps_cases.studies.chart import bench, bench_model

    if part == "laws":
        return {"pressures of four laws": bench.bytes_per_particle()}
    if part == "model":
        return {f"2D {option}": bench_model.bytes_per_particle(option) for option in ("quintic", "RK1")}
    return {}


def _show(ratio: Ratio) -> None:
    unit, scale = ("ns", 1.0) if ratio.ours_ns.median < 1e5 else ("ms", 1e-6)

    def text(value: ConfidenceInterval) -> str:
        return f"{value.median * scale:.2f} {unit}"

    spread = f"{ratio.ratio.median:.2f} ({ratio.ratio.low:.2f} to {ratio.ratio.high:.2f})"
    click.echo(f"{ratio.scene:42s} {ratio.peer:18s} {text(ratio.ours_ns):>12s} {text(ratio.peer_ns):>12s}  {spread}")
