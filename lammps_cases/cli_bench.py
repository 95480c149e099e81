"""eos-ref bench."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from lammps_cases.cli_shared import json_option

if TYPE_CHECKING:
    from lammps_cases.bench import Ratio


@click.command("bench", short_help="Speed against peers, as ratios.")
@click.argument("parts", nargs=-1, type=click.Choice(["laws", "model", "runs"]))
@click.option("--states", type=click.IntRange(1000), default=10_000_000, show_default=True, help="States per law.")
@click.option("--repeats", type=click.IntRange(1), default=5, show_default=True, help="Measurements of each side.")
@json_option
def bench_command(parts: tuple[str, ...], states: int, repeats: int, as_json: bool) -> int:
    """Measure speed in one run against peers, as ratios ours/peer, in turns with each of them.

    PARTS: laws (equations of state against memory copies), model (time steps against LAMMPS' own, one core each), runs
    (whole programs). All of them by default; the model takes some minutes.

    \b
    Example:  eos-ref bench laws --states 1000000
    """
    chosen = parts or ("laws", "model", "runs")
    ratios: list[Ratio] = []
    memory: dict[str, float] = {}
    for part in chosen:
        for ratio in _measured(part, states, repeats):
            ratios.append(ratio)
            if not as_json:
                _show(ratio)
        memory |= _memory(part)
    if as_json:
        rows = [
            {"scene": r.scene, "peer": r.peer, "ours_ns": r.ours_ns, "peer_ns": r.peer_ns, "ratio": r.ratio}
            for r in ratios
        ]
        click.echo(json.dumps({"ratios": rows, "bytes_per_particle": memory}, indent=1))
        return 0
    for what, size in memory.items():
        click.echo(f"peak memory, a million particles, {what}: {size:.0f} bytes per particle")
    return 0


def _measured(part: str, states: int, repeats: int) -> Iterator[Ratio]:
    from lammps_cases import bench, bench_model

    if part == "laws":
        yield from bench.laws_against_copy(states, repeats)
        yield bench.table_against_copy(states, repeats)
    elif part == "model":
        yield from bench_model.against_lammps((2, 3), repeats)
        yield from bench_model.growth()
        yield bench_model.full_model_for_pressure()
    else:
        for jobs in (1, 2):
            yield bench.run_against_lammps(repeats, jobs)
        yield bench.help_against_python(repeats)


def _memory(part: str) -> dict[str, float]:
    from lammps_cases import bench, bench_model

    if part == "laws":
        return {"pressures of four laws": bench.bytes_per_particle()}
    if part == "model":
        return {f"2D {option}": bench_model.bytes_per_particle(option) for option in ("quintic", "RK1")}
    return {}


def _show(ratio: Ratio) -> None:
    unit, scale = ("ns", 1.0) if ratio.ours_ns < 1e5 else ("ms", 1e-6)
    ours, peer = f"{ratio.ours_ns * scale:.2f} {unit}", f"{ratio.peer_ns * scale:.2f} {unit}"
    click.echo(f"{ratio.scene:44s} {ratio.peer:22s} {ours:>13s} {peer:>13s} {ratio.ratio:7.2f}")
