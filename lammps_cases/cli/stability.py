"""eos-ref stability."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from lammps_cases.cli.shared import engine_option, json_option
from lammps_cases.records.progress import Bar


@click.command("stability")
@click.argument("names", nargs=-1, metavar="[MAP]...")
@click.option("--quick", is_flag=True, help="Only the maps tagged quick, on few lines: about a minute.")
@click.option("--tag", help="Only maps with this tag.")
@click.option("--cell", metavar="MAP:LAYER:X:Y", help="Run one cell on both engines, and write its deck.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default="reports/stability",
    show_default=True,
    help="Folder of the atlas.",
)
@click.option("--jobs", type=click.IntRange(1), default=2, show_default=True, help="Processes at a time.")
@click.option("--fresh", is_flag=True, help="Run every cell again, also those that the folder has.")
@click.option("--save-limits", is_flag=True, help="Keep the measured limits of the time step as those of the advice.")
@engine_option
@json_option
def stability_command(
    names: tuple[str, ...],
    quick: bool,
    tag: str | None,
    cell: str | None,
    out: Path,
    jobs: int,
    fresh: bool,
    save_limits: bool,
    engine: str,
    as_json: bool,
) -> int:
    """Find where methods break, how, and whether LAMMPS and the reference break at the same place.

    Without names: every map that is not tagged long, and what LAMMPS does with bad input. Writes report.html,
    atlas.json, cells.csv, inputs.json, decks/ and figures/; a run that was stopped goes on where it was left.

    \b
    Example:  eos-ref stability --quick
              eos-ref stability timestep-viscosity --jobs 2
              eos-ref stability --cell timestep-viscosity::5.0:1.0
    """
    from lammps_cases.engine import installations

    if cell is not None:
        return _one_cell(cell, out, installations.resolve(engine).site, as_json)
    from lammps_cases.run.campaign import command_line
    from lammps_cases.studies.stability import atlas, expected, inputs, page, record, select
    from lammps_cases.studies.stability.maps import maps

    chosen = select.maps(maps(), names, tag or ("quick" if quick and not names else None))
    site = installations.resolve(engine).site
    if fresh:
        record.cells(out).forget()
    with Bar(quiet=as_json) as bar:
        found = atlas.measure(chosen, out, command_line(), quick=quick, site=site, jobs=jobs, progress=bar)
        rows = inputs.write(out, site, jobs, bar) if not names and tag is None else inputs.read(out)
        page.write(found, out, maps(), rows)
    if save_limits:
        from lammps_cases.studies.stability import limits

        edges = [b for m in found.maps for b in m.boundaries]
        limits.save(limits.measured(edges, maps(), found.engine.get("distribution", "")))
    unexplained = expected.unexplained(found.disagreements)
    if as_json:
        click.echo(json.dumps(record.document(found), indent=1))
    else:
        _show(found, len(unexplained), out)
    return int(bool(unexplained))


def _show(found: Any, unexplained: int, out: Path) -> None:
    for one in found.maps:
        differ = sum(line.verdict == "differs" for line in one.agreement)
        fails = sum(ran.outcome.kind != "stable" for ran in one.cells)
        told = f"{differ} of {len(one.agreement)} lines differ"
        click.echo(f"{one.id:24s} {len(one.cells):5d} runs, {fails:5d} fail, {told} ({one.seconds:.1f} s)")
    click.secho(f"{unexplained} lines differ without a known finding ({found.seconds:.1f} s)", bold=True)
    click.echo(f"report: {out / 'report.html'}")


def _one_cell(text: str, out: Path, site: str | None, as_json: bool) -> int:
    """Run a cell on both engines."""
    from lammps_cases.engine.workers import Workers
    from lammps_cases.studies.stability import expected, names, page, probe, select
    from lammps_cases.studies.stability.maps import maps

    cell = names.parse(text)
    of = select.of_cell(maps(), cell)
    with Workers(site, 1) as workers:
        ended = {side: probe.examine(of, cell, side, workers).outcome for side in reversed(of.engines(cell.layer))}
    out.mkdir(parents=True, exist_ok=True)
    written = page.write_deck(of, cell, out)
    path = str(out / written) if written else ""
    differ = len({outcome.kind for outcome in ended.values()}) > 1 and expected.expected_difference(cell) is None
    if as_json:
        from dataclasses import asdict

        from lammps_cases.records.wording import plain

        document: dict[str, Any] = {"cell": names.name(cell), "deck": path}
        document |= {side: asdict(outcome) for side, outcome in ended.items()}
        click.echo(json.dumps(plain(document), indent=1))
        return int(differ)
    click.secho(f"{of.title}: {of.x.name} = {cell.x:.6g}, {of.y.name} = {cell.y:.6g} {cell.layer}".rstrip(), bold=True)
    for side, o in ended.items():
        parts = [
            f"{label} {v:.6g}" for label, v in (("step", o.step), ("atom", o.atom), ("value", o.value)) if v is not None
        ]
        said = f": {o.message}" if o.message else ""
        click.echo(f"{'LAMMPS' if side == 'lammps' else side:10s} {o.kind}{', ' * bool(parts)}{', '.join(parts)}{said}")
    click.echo(f"deck: {path}" if path else "deck: none, it holds numbers that LAMMPS reads from no deck")
    return int(differ)
