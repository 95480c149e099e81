"""eos-ref bench."""

from __future__ import annotations

import json

import click

from lammps_cases.cli_shared import json_option


@click.command("bench", short_help="Speed against peers, as ratios.")
@click.option("--states", type=click.IntRange(1000), default=10_000_000, show_default=True, help="States per law.")
@click.option("--repeats", type=click.IntRange(1), default=7, show_default=True, help="Measurements of each side.")
@json_option
def bench_command(states: int, repeats: int, as_json: bool) -> int:
    """Measure speed in one run against peers, as ratios ours/peer: copies for the laws, LAMMPS alone for a run.

    \b
    Example:  eos-ref bench --states 1000000
    """
    from lammps_cases import bench

    ratios = [*bench.laws_against_copy(states, repeats), bench.table_against_copy(states, repeats)]
    ratios += [bench.run_against_lammps(3, jobs) for jobs in (1, 2)]
    ratios.append(bench.help_against_python(repeats))
    memory = bench.bytes_per_particle()
    if as_json:
        rows = [
            {"scene": r.scene, "peer": r.peer, "ours_ns": r.ours_ns, "peer_ns": r.peer_ns, "ratio": r.ratio}
            for r in ratios
        ]
        click.echo(json.dumps({"ratios": rows, "bytes_per_particle": memory}, indent=1))
        return 0
    click.echo(f"{'scene':44s} {'peer':22s} {'ours':>12s} {'peer':>12s} {'ratio':>7s}")
    for r in ratios:
        unit, scale = ("ns", 1.0) if r.ours_ns < 1e5 else ("ms", 1e-6)
        ours, peer = f"{r.ours_ns * scale:.2f} {unit}", f"{r.peer_ns * scale:.2f} {unit}"
        click.echo(f"{r.scene:44s} {r.peer:22s} {ours:>12s} {peer:>12s} {r.ratio:7.2f}")
    click.echo(f"peak memory of the reference at 1,000,000 states: {memory:.0f} bytes per particle")
    return 0
