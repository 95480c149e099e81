"""eos-ref audit."""

from __future__ import annotations

from pathlib import Path

import click

from lammps_cases.cli_shared import Bar, engine_option, finish, json_option, strict_option
from lammps_cases.records import CaseRecord


@click.command("audit", short_help="Check a LAMMPS input deck while LAMMPS runs it, unchanged.")
@click.argument("deck", type=click.Path(path_type=Path))
@click.option("--every", default=10, show_default=True, metavar="M", help="Look at all atoms every M time steps.")
@click.option("--steps", type=int, metavar="N", help="Stop after N time steps in all.  [default: the whole deck]")
@click.option("--timeout", type=float, metavar="S", help="Stop after S seconds.  [default: none]")
@click.option("--allow-shell", is_flag=True, help="Let the deck run shell commands, Python and plugins.")
@click.option("--out", type=click.Path(path_type=Path), help="Report folder.  [default: reports/audit-DECK]")
@engine_option
@strict_option
@json_option
def audit_command(
    deck: Path,
    every: int,
    steps: int | None,
    timeout: float | None,
    allow_shell: bool,
    out: Path | None,
    engine: str,
    strict: bool,
    as_json: bool,
) -> int:
    """Check the pressure of every atom while LAMMPS runs DECK, unchanged, in a copy of its folder.

    Checked is P = EOS(rho, e), with the laws that fix rheo and fix rheo/pressure hold at that moment, where the
    forces use it. Loops, includes, several runs and redefined fixes are followed.

    \b
    Example:  eos-ref audit in.deck --every 10 --steps 1000
    """
    from lammps_cases import campaign, engines
    from lammps_cases.audit import AuditOptions, audit_deck
    from lammps_cases.records import write_arrays

    chosen = engines.resolve(engine)
    directory = out or Path("reports") / f"audit-{deck.name}"
    with Bar(quiet=as_json) as bar, campaign.output_folder(directory) as folder:

        def progress(done: int, total: int | None) -> None:
            bar.show(done, total, "steps")

        result = audit_deck(deck, AuditOptions(every, steps, timeout, allow_shell, chosen.site, progress))
        run = campaign.provenance(campaign.engine_record(chosen, result.who), campaign.command_line())
        run.cases, run.seconds, run.strict = result.record.cases, result.record.seconds, strict
        if result.arrays:
            write_arrays(folder / "fields" / f"{run.cases[0].case}.npz", result.arrays)
        campaign.write_run(run.counted(), folder)
    if not as_json:
        for line in report_lines(run.cases[0]):
            click.echo(line)
    return finish(run, directory, as_json)


def report_lines(case: CaseRecord, most: int = 40) -> list[str]:
    """A table per look and type, shortened in the middle, then the types, the warnings, and the message."""
    looks = [
        f"{check.run:4d} {check.step:9d} {check.type:4d} {check.natoms:8d}  {check.verdict:8s} "
        f"{check.max_abs:10.3g} {check.max_over_bound:10.3g} {check.worst_id:8d}"
        for check in case.checks
    ]
    if len(looks) > most:
        looks[most // 2 : -most // 2] = [f" ... {len(looks) - most} more, all in run.json ..."]
    head = " run      step type    atoms  verdict   |LAMMPS-ref|   /bound worst atom"
    types = [
        f"type {record.atom_type}: {record.verdict}, at most {record.max_over_bound:.3g} x bound (step "
        f"{record.worst_step}, atom {record.worst_id})"
        for record in case.fields
    ]
    warnings = [f"warning: {line}" for line in case.warnings]
    end = f"{case.case}: {case.verdict}, {case.steps} steps, {case.natoms} atoms"
    return [head, *looks, *types, *warnings, f"{end}: {case.message}" if case.message else end]
