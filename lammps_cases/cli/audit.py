"""eos-ref audit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import click

from eos_ref.errors import InputError
from lammps_cases.cli import deck_baselines, shared
from lammps_cases.records.levels import FailOn
from lammps_cases.records.progress import Bar
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.wording import listed, unchecked

BESIDE = "eos-ref-baseline"


@click.command("audit")
@click.argument("deck", type=shared.PATH, required=False)
@click.option("--deck", "of_deck", type=shared.PATH, metavar="DECK", help="The same as DECK.")
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
@click.option("-sf", "--suffix", metavar="STYLE", help="Style suffix, as LAMMPS' own switch -sf.")
@click.option("--budgets", is_flag=True, help="Also follow momentum and energy, and where they are lost.")
@click.option(
    "--trust",
    is_flag=True,
    envvar="EOS_REF_TRUST",
    help="Let the deck run programs, and read and write files with your own file permissions.",
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
    every: int,
    steps: int | None,
    fields: str,
    timeout: float,
    suffix: str | None,
    budgets: bool,
    trust: bool,
    accept: bool,
    reason: str,
    baseline: str | None,
    out: Path | None,
    engine: str,
    fail_on: FailOn | None,
    as_json: bool,
) -> int:
    """Check every atom while LAMMPS runs DECK, unchanged, in a copy of its folder, and say which known bugs affect it.

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
              eos-ref audit decks --accept --reason "first baseline"
              eos-ref audit decks --baseline
    """
    from lammps_cases.audit import AuditOptions
    from lammps_cases.audit.command import audit_into
    from lammps_cases.engine import installations
    from lammps_cases.run import provenance

    if (reason and not accept) or ((accept or baseline) and (dump or restart)):
        rule = "needs --accept" if reason and not accept else "is of a deck that runs, not of --dump or --restart"
        raise InputError("--reason" if reason and not accept else "--accept or --baseline", rule)
    if (deck is None) == (of_deck is None):
        raise InputError("deck", "must be given once: eos-ref audit DECK, or --deck DECK")
    deck = deck or of_deck
    assert deck is not None
    chosen = installations.resolve(engine)
    directory = out or Path("reports") / f"audit-{(dump or restart or deck).resolve().name}"
    place = (deck if deck.is_dir() else deck.parent) / BESIDE if baseline in (None, BESIDE) else Path(baseline or "")
    if baseline and not accept:
        deck_baselines.readable(place)
    with Bar(quiet=as_json) as bar:
        names = tuple(name.strip() for name in fields.split(",") if name.strip())
        options = AuditOptions(
            every, steps, timeout, trust, chosen.site, bar, fields=names, suffix=suffix, budgets=budgets
        )
        run = audit_into(directory, deck, options, chosen, provenance.command_line(), fail_on or "new", dump, restart)
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
    return shared.finish(run, directory, as_json, changes)


def known_bugs(case: CaseRecord) -> list[str]:
    """Return a line for every known finding that touches the deck: what it does there, and what to do meanwhile."""
    from lammps_cases.findings import LEDGER
    from lammps_cases.report.findings import touching

    workaround = {entry.id: entry.workaround for entry in LEDGER}
    return [f"{name}: {does}. {workaround[name]}" for name, does in touching(case).items()]


def field_table(case: CaseRecord) -> list[str]:
    """Return the lines of a table of the fields; none if none was checked."""
    looks = Counter((check.field, check.type) for check in case.checks)
    atoms = {(check.field, check.type): check.natoms for check in case.checks}
    head = "field        type samples  atoms   |LAMMPS-ref|     /bound worst step worst atom  verdict"
    rows = [
        f"{record.field:12s} {record.atom_type or 'all':>4} {looks[record.field, record.atom_type or 0]:6d} "
        f"{atoms[record.field, record.atom_type or 0]:7d} "
        f"{record.max_abs:14.3g} {record.max_over_bound:10.3g} {record.worst_step:9d} {record.worst_id:10d}  "
        f"{record.verdict}" + (f" by {listed(record.explained_by)}" if record.explained_by else "")
        for record in case.fields
    ]
    return [head, *rows] if rows else []


def report_lines(case: CaseRecord, most: int = 20) -> list[str]:
    """Return the looks outside the bound, what was not checked, what to mind, and how the run ended.

    What no audit checks stands in one line: the report gives the reasons.
    """
    bad = [check for check in case.checks if check.verdict == "differs"]
    outside = [
        f"outside: {check.field} of type {check.type or 'all'}, run {check.run}, step {check.step}: "
        f"{check.max_abs:.3g} = {check.max_over_bound:.3g} x bound at atom {check.worst_id}"
        for check in bad[:most]
    ]
    if len(bad) > most:
        outside.append(f"... {len(bad) - most} more samples outside, all in run.json ...")
    from lammps_cases.audit import balance
    from lammps_cases.audit.fields import unaudited

    not_checked = [f"not checked: {line}" for line in unchecked(case, unaudited())]
    warnings = [f"warning: {line}" for line in case.warnings]
    warnings += [f"stability: {line}" for line in case.stability]
    bugs = [f"known bug {line}" for line in known_bugs(case)]
    bugs += [f"budget: {line}" for line in balance.lines(case)] if case.budgets else []
    end = f"{case.case}: {case.verdict}, {case.steps} steps, {case.natoms} atoms"
    if case.message and case.as_expected:  # else the message follows, with the cases not as expected
        end += f": {case.message}"
    return [*outside, *not_checked, *warnings, *bugs, end]
