"""eos-ref fuzz."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from lammps_cases.cli import shared
from lammps_cases.records.progress import Bar

if TYPE_CHECKING:
    from tests.workshop.fuzz.record import FuzzRecord

RAREST = 8  # choices named


@click.command("fuzz")
@click.option("--seconds", type=click.FloatRange(0, min_open=True), default=60.0, show_default=True, help="Time.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of the scenes.")
@click.option("--draw", type=click.IntRange(0), help="Only this scene, by its number.")
@click.option("--shrink/--no-shrink", "shrinks", default=True, help="Shrink red scenes, or keep them as drawn.")
@shared.engine_option
@shared.jobs_option
@shared.cluster_option
@shared.folder_option("--out", "reports/fuzz", "Folder of fuzz.html, fuzz.json and the red scenes.")
@shared.json_option
def fuzz_command(
    seconds: float, seed: int, draw: int | None, shrinks: bool, engine: str, jobs: int, out: Path, as_json: bool
) -> int:
    """Draw random scenes over the whole schema of case files, and judge each as eos-ref run does.

    Scenes that are red and not explained by a finding are kept as case files, and shrunk. Scene k of a seed is the same
    on every machine. Exit code 1 if something is unexplained; Ctrl-C reports what was done so far.

    \b
    Example:  eos-ref fuzz --seconds 600 --seed 7
              eos-ref fuzz --seed 7 --draw 123
    """
    shared.start_fork_server()
    shared.page_folder(out)
    from lammps_cases.engine import installations
    from tests.workshop.fuzz import page
    from tests.workshop.fuzz.hunt import Hunt
    from tests.workshop.fuzz.record import DOCUMENT
    from lammps_cases.run.provenance import command_line

    with Bar(quiet=as_json, complaints=True) as bar:
        hunt = Hunt(
            installations.resolve(engine),
            seed,
            seconds,
            jobs,
            out,
            first=draw or 0,
            scenes=None if draw is None else 1,
            shrinks=shrinks,
            command=command_line(),
            progress=bar,
        )
        record = hunt.run()
    written = page.write(record, out)
    if as_json:
        click.echo(DOCUMENT.text(record), nl=False)
    else:
        _print(record)
        click.echo(f"page: {written}")
    return record.exit_code


def _print(record: FuzzRecord) -> None:
    from lammps_cases.records.wording import counted

    counts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(record.verdicts.items()))
    end = "; interrupted" if record.interrupted else ""
    title = f"{counted(record.drawn, 'random scene')} of seed {record.seed}: {counts} ({record.seconds:.0f} s{end})"
    click.secho(title, bold=True)
    for red in record.red:
        click.secho(f"  draw {red.draw}: {red.message}", fg="red")
        click.echo(f"    {red.reproduce}")
        if red.small:
            click.echo(f"    reduced to {counted(red.small_particles or 0, 'particle')}: {red.small}")
    if record.findings:
        named = ", ".join(f"{name} {count}" for name, count in sorted(record.findings.items()))
        click.echo(f"  explained by findings: {named}")
    for name, count in record.gaps.items():
        click.echo(f"  {name}: {counted(count, 'scene')} changed by it and not reproduced by any variant")
    if record.lost:
        lost = counted(record.lost, "scene")
        click.echo(f"  {lost} with lost particles, in LAMMPS and the reference or only in the latter")
    if record.unbounded:
        open_ = counted(record.unbounded, "scene")
        click.echo(f"  {open_} with values without a bound, the rest reproduced by known findings")
    drawn = sum(map(bool, record.choices.values()))
    click.echo(
        f"  {counted(record.twins, 'twin')}; {drawn} of {len(record.choices)} choices of the schema drawn, "
        f"{record.pairs_drawn} of {record.pairs} pairs, possible or not; "
        f"{100 * record.rejection:.1f} % of draws rejected as invalid"
    )
    rarest = sorted(record.choices.items(), key=lambda item: item[1])[:RAREST]
    click.echo("  rarest: " + ", ".join(f"{choice} {count}" for choice, count in rarest))
