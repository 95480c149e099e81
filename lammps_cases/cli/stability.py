"""eos-ref stability."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from lammps_cases.cli import shared
from lammps_cases.cli.shared import engine_option, json_option
from lammps_cases.records.progress import Bar


@click.command("stability")
@click.argument("names", nargs=-1, metavar="[MAP]...")
@click.option("--quick", is_flag=True, help="Only the maps tagged quick, with few lines: about a minute.")
@click.option("--tag", help="Only maps with this tag.")
@click.option("--cell", metavar="MAP:LAYER:X:Y", help="Run one cell on both engines, and write its deck.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default="reports/stability",
    show_default=True,
    help="Folder of the atlas.",
)
@shared.processes_option
@shared.cluster_option
@shared.resume_option
@click.option("--save-limits", is_flag=True, help="Base later advice on the measured limits.")
@engine_option
@json_option
def stability_command(
    names: tuple[str, ...],
    quick: bool,
    tag: str | None,
    cell: str | None,
    out: Path,
    jobs: int,
    resume: bool,
    save_limits: bool,
    engine: str,
    as_json: bool,
) -> int:
    """Find where methods fail, how, and whether LAMMPS and the reference fail at the same place.

    Without names: every map that is not tagged long. Writes report.html, atlas.json, cells.csv, decks/ and figures/; an
    interrupted run is resumed.

    \b
    Example:  eos-ref stability --quick
              eos-ref stability timestep-viscosity --jobs 2
              eos-ref stability --cell timestep-viscosity::5.0:1.0
    """
    from lammps_cases.engine import installations

    shared.page_folder(out)
    if cell is not None:
        return _one_cell(cell, out, installations.resolve(engine).site, as_json)
    from lammps_cases.run.provenance import command_line
    from lammps_cases.studies.stability import atlas, limits, maps, page, record

    by_id = maps.MAPS
    chosen = maps.select(by_id, names, tag or ("quick" if quick and not names else None))
    site = installations.resolve(engine).site
    with record.cells(out).resumed(resume), Bar(quiet=as_json) as bar:
        measured = atlas.measure(chosen, out, command_line(), quick=quick, site=site, jobs=jobs, progress=bar)
        page.write(measured, out, by_id)
    if save_limits:
        edges = [b for of in measured.maps for b in of.boundaries]
        limits.save(limits.measured(edges, by_id, measured.engine.get("distribution", "")))
    unexplained = maps.unexplained(measured.disagreements)
    if as_json:
        click.echo(json.dumps(record.document(measured), indent=1))
    else:
        _show(measured, len(unexplained), out)
    return int(bool(unexplained))


def _show(atlas: Any, unexplained: int, out: Path) -> None:
    for of in atlas.maps:
        differ = sum(line.verdict == "differs" for line in of.agreement)
        fails = sum(run.outcome.kind != "stable" for run in of.cells)
        lines = f"{differ} of {len(of.agreement)} lines differ"
        click.echo(f"{of.id:24s} {len(of.cells):5d} runs, {fails:5d} fail, {lines} ({of.seconds:.1f} s)")
    click.secho(f"{unexplained} lines differ for no known reason ({atlas.seconds:.1f} s)", bold=True)
    click.echo(f"report: {out / 'report.html'}")


def _one_cell(name: str, out: Path, site: str | None, as_json: bool) -> int:
    """Run a cell on both engines."""
    from lammps_cases.engine.workers import Workers
    from lammps_cases.studies.stability import maps, page, probe
    from lammps_cases.studies.stability.model import MapCell

    cell = MapCell.parse(name)
    of = maps.of_cell(maps.MAPS, cell)
    with Workers(site, 1) as workers:
        ends = {side: probe.examine(of, cell, side, workers).outcome for side in reversed(of.engines(cell.layer))}
    out.mkdir(parents=True, exist_ok=True)
    deck = page.write_deck(of, cell, out)
    path = str(out / deck) if deck else ""
    differ = len({outcome.kind for outcome in ends.values()}) > 1 and maps.expected_difference(cell) is None
    if as_json:
        from dataclasses import asdict

        from lammps_cases.records.wording import plain

        document: dict[str, Any] = {"cell": cell.name, "deck": path}
        document |= {side: asdict(outcome) for side, outcome in ends.items()}
        click.echo(json.dumps(plain(document), indent=1))
        return int(differ)
    click.secho(f"{of.title}: {of.x.name} = {cell.x:.6g}, {of.y.name} = {cell.y:.6g} {cell.layer}".rstrip(), bold=True)
    for side, o in ends.items():
        numbers = {"step": o.step, "atom": o.atom, "value": o.value}
        parts = [o.kind, *(f"{label} {value:.6g}" for label, value in numbers.items() if value is not None)]
        message = f": {o.message}" if o.message else ""
        click.echo(f"{page.WHO[side]:10s} {', '.join(parts)}{message}")
    click.echo(f"deck: {path}" if path else "deck: none, as it has numbers that LAMMPS cannot read from a deck")
    return int(differ)
