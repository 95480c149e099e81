"""eos-ref audit."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from eos_ref.errors import InputError
from lammps_cases.cli import deck_baselines, shared, switches
from lammps_cases.records.levels import FailOn
from lammps_cases.records.progress import Bar
from lammps_cases.records.run_record import CaseRecord, CheckRecord
from lammps_cases.records.wording import listed, size

BESIDE = "eos-ref-baseline"


@click.command("audit", cls=switches.AsLammps)
@click.argument("deck", type=shared.PATH, required=False)
@click.option("--deck", "-in", "-i", "of_deck", type=shared.PATH, metavar="DECK", help="The same as DECK.")
@click.option("--dump", type=shared.PATH, metavar="FILE", help="Check a dump written by DECK, without running it.")
@click.option("--restart", type=shared.PATH, metavar="FILE", help="Check a restart file written by DECK.")
@click.option("--every", default=10, show_default=True, metavar="M", help="Check all atoms every M time steps.")
@click.option("--steps", type=int, metavar="N", help="Stop after N time steps in all.  [default: the whole deck]")
@click.option(
    "--fields",
    default="all",
    show_default=True,
    metavar="NAME,...",
    help="What to check, by LAMMPS' names (pressure, coordination, grad/v, f, ...); all: whatever can be checked.",
)
@click.option("--timeout", type=float, default=3600.0, metavar="S", help="Stop after S seconds.  [default: an hour]")
@switches.described
@click.option("-sf", "--suffix", "-suffix", metavar="STYLE", help="Style suffix, as LAMMPS' own switch.")
@click.option("--root", type=shared.PATH, metavar="DIR", help="Copy DIR, for decks that read files in folders beside.")
@click.option(
    "--ranks", default=1, show_default=True, metavar="N", help="Run LAMMPS on N MPI ranks, as mpirun -np N lmp."
)
@click.option("--budgets", is_flag=True, help="Also follow momentum and energy, and where they are lost.")
@click.option(
    "--trust",
    is_flag=True,
    envvar="EOS_REF_TRUST",
    help="Let the deck run programs, and read and write files with your own file permissions.",
)
@click.option(
    "--rescale",
    type=shared.PATH,
    is_flag=False,
    flag_value="",
    metavar="[FILE]",
    help="Write DECK in the unit of length in which m/rho0 is 1.  [default: DECK.rescaled]",
)
@click.option("--accept", is_flag=True, help="Keep what the deck did as its baseline, as text for a repository.")
@click.option("--reason", default="", metavar="TEXT", help="Why it is accepted; kept with the baseline.")
@click.option(
    "--baseline",
    is_flag=False,
    flag_value=BESIDE,
    metavar="[FOLDER]",
    help=f"Compare with the accepted baseline: exit 1 if anything changed.  [default: {BESIDE} beside the deck]",
)
@click.option("--out", type=shared.PATH, help="Report folder.  [default: reports/audit-DECK]")
@shared.engine_option
@shared.fail_on_option
@shared.json_option
def audit_command(
    deck: Path | None,
    of_deck: Path | None,
    dump: Path | None,
    restart: Path | None,
    rescale: Path | None,
    accept: bool,
    reason: str,
    baseline: str | None,
    out: Path | None,
    engine: str,
    fail_on: FailOn | None,
    as_json: bool,
    **options: Any,
) -> int:
    """Check every atom while LAMMPS runs DECK, unchanged, in a copy of its folder, and say which known bugs affect it.

    It takes the switches of lmp, and runs in a copy of the current folder if the files that DECK reads lie there.

    DECK may be a folder: all decks below it (in.*, *.in, *.lmp) are audited. Findings that are accepted, with reason
    and date, and limits stand in eos-ref.toml beside the decks.

    It checks whatever a force evaluation computes from positions, velocities, densities, energies and phases, as used
    by the forces: the pressure by the laws that the deck defines at that moment, gradients, surfaces, forces. Loops,
    includes, several runs and redefined fixes are followed. If LAMMPS stops with an error, the reference continues
    from the last good sample to find out why.

    With --dump or --restart only the set-up is run: the columns of a dump are checked against each other, to the
    digits that it holds; LAMMPS reads a restart file and evaluates its forces once.

    \b
    Examples: eos-ref audit in.deck --every 10 --steps 1000
              eos-ref audit in.deck --fields pressure,surface,grad/v
              eos-ref audit --dump out.dump --deck in.deck
              eos-ref audit in.deck --rescale in.rescaled
              eos-ref audit decks --accept --reason "first baseline"
              eos-ref audit decks --baseline
    """
    from lammps_cases.audit import AuditOptions
    from lammps_cases.audit.command import audit_into
    from lammps_cases.audit.rescale import rescale as rescale_deck
    from lammps_cases.engine import installations
    from lammps_cases.run import provenance

    if (reason and not accept) or ((accept or baseline) and (dump or restart)):
        rule = "needs --accept" if reason and not accept else "is of a deck that runs, not of --dump or --restart"
        raise InputError("--reason" if reason and not accept else "--accept or --baseline", rule)
    if (deck is None) == (of_deck is None):
        before = " before -var" if options["var"] else ""
        raise InputError("deck", f"must be given once{before}: eos-ref audit DECK, or --deck DECK")
    deck = deck or of_deck
    assert deck is not None
    chosen = installations.resolve(engine)
    directory = out or Path("reports") / f"audit-{(dump or restart or deck).resolve().name}"
    place = (deck if deck.is_dir() else deck.parent) / BESIDE if baseline in (None, BESIDE) else Path(baseline or "")
    if baseline and not accept:
        deck_baselines.readable(place)
    with Bar(quiet=as_json) as bar:
        how = AuditOptions.of(engine=chosen.site, progress=bar, **options)
        target = rescale if rescale and rescale.name else Path(f"{deck.name}.rescaled")
        written = [] if rescale is None else rescale_deck(deck, how, target)
        run = audit_into(directory, deck, how, chosen, provenance.command_line(), fail_on or "new", dump, restart)
    changes: Iterable[str] = ()
    if accept:
        changes = deck_baselines.accepted(directory, reason, place, prune=deck.is_dir())
    elif baseline:
        changes = deck_baselines.against(place, run, directory, deck, as_json)
    if not as_json:
        for case in run.cases:
            for line in () if deck.is_dir() else field_table(case):
                click.echo(line)
            for line in report_lines(case)[-1 if deck.is_dir() else 0 :]:
                shared.show(line, "  ")
        for line in written:
            shared.show(f"rescaled: {line}", "  ")
    return shared.finish(run, directory, as_json, changes)


def field_table(case: CaseRecord) -> list[str]:
    """Return the lines of a table of the fields; none if none was checked."""
    from lammps_cases.records import deck_wording

    looks: dict[tuple[str, int], list[CheckRecord]] = {}
    for check in case.checks:
        looks.setdefault((check.field, check.type), []).append(check)
    lines = ["field        type samples  atoms   |LAMMPS-ref|     /bound worst step worst atom  verdict"]
    for record in case.fields:
        of_field = looks.get((record.field, record.atom_type or 0), [])
        worst = max(of_field, key=lambda check: size(check.max_over_bound), default=None)
        lines.append(
            f"{record.field:12s} {record.atom_type or 'all':>4} {len(of_field):6d} {worst.natoms if worst else 0:7d} "
            f"{record.max_abs:14.3g} {record.max_over_bound:10.3g} {record.worst_step:9d} {record.worst_id:10d}  "
            f"{deck_wording.verdict(record)}" + (f" by {listed(record.explained_by)}" if record.explained_by else "")
        )
    return lines if case.fields else []


def report_lines(case: CaseRecord, most: int = 20) -> list[str]:
    """Return the looks outside the bound, all that the report says of the deck, and how the run ended."""
    from lammps_cases.audit import balance
    from lammps_cases.report.statements import NEVER, SUBJECTS, statements

    bad = [check for check in case.checks if check.verdict == "differs"]
    outside = [
        f"outside: {check.field} of type {check.type or 'all'}, run {check.run}, step {check.step}: "
        f"{check.max_abs:.3g} = {check.max_over_bound:.3g} x bound at atom {check.worst_id}"
        for check in bad[:most]
    ]
    if len(bad) > most:
        outside.append(f"... {len(bad) - most} more samples outside, all in run.json ...")
    budget = [f"budget: {line}" for line in balance.lines(case)] if case.budgets else []
    end = f"{case.case}: {case.verdict}, {case.steps} steps, {case.natoms} atoms"
    if case.message and case.as_expected:  # else it follows, with why the run stopped
        end += f": {case.message}"
    # What matters most stands last, where it is read first.
    said = sorted(statements(case, NEVER), key=lambda line: -SUBJECTS.index(line.subject))
    return [*outside, *(str(line) for line in said if line.subject != "stopped"), *budget, end]
