"""eos-ref claims."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import Engines, Json, command
from lammps_cases.records.options import Option, Positional
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import Jobs, LevelOptions, processes

if TYPE_CHECKING:
    from lammps_cases.claims.model import Claim
    from lammps_cases.claims.verdicts import Trace
    from lammps_cases.records.run_record import CaseRecord, RunRecord
    from lammps_cases.report.pages.claims import Column
    from lammps_cases.scene.casefile import Case

MOST_TEXT = 160  # characters of evidence
PROBES = ".probes.json"  # the records of an engine's probes, next to the report of its cases


@dataclass(frozen=True)
class ListOptions:
    """Options that only list."""

    traceability: Annotated[bool, Option("Only list claims without a case and cases without a claim.")] = False
    manuals: Annotated[bool, Option("Only list claims that are not in every version of the manual.")] = False


@command()
def claims_command(
    names: Annotated[tuple[str, ...], Positional(metavar="[CLAIM]...")] = (),
    runs: Annotated[tuple[Path, ...], Option("Judge from a finished run; run nothing.", "--run")] = (),
    engines: Engines = (),
    out: Annotated[Path | None, Option("Folder of the page.  [default: by date, in reports/claims]")] = None,
    jobs: Jobs = None,
    *,
    listed: ListOptions,
    level: LevelOptions,
    as_json: Json = False,
) -> int:
    """Say for every statement of the two manual pages whether it holds in LAMMPS, and which cases show it.

    A name selects a claim, a pattern several; so does a page, a kind, or a case. Runs the cases that are needed, and
    small decks for what no scene can say, and writes claims.html and claims.json. A claim that a known finding
    contradicts does not hold, but leaves the exit code at 0; one that fails without a finding makes it 1. Without --out
    reports/claims/latest points to the last page of all claims; pages of some are kept in reports/claims-parts.

    \b
    Example:  eos-ref claims
              eos-ref claims 'pressure-tait*' --engine pypi:2025.7.22.1.0 --engine env
              eos-ref claims --run reports/latest
    """
    if not (runs or listed.traceability or listed.manuals):
        shared.start_fork_server()
    from lammps_cases.claims import model
    from lammps_cases.claims.probes import manual
    from lammps_cases.claims.verdicts import trace
    from lammps_cases.records import folders
    from lammps_cases.records.files import write_atomically
    from lammps_cases.records.run_record import read_run
    from lammps_cases.report.pages import claims as page
    from lammps_cases.scene import casefile

    chosen = model.select(names)
    cases = casefile.load()
    case_names = [*(case.name for case in cases), *(probe.name for probe in manual.probes())]
    leads = trace(model.claims(), case_names)
    cases = [case for case in cases if casefile.MORE not in case.tags]
    known = [*(case.name for case in cases), *(probe.name for probe in manual.probes())]
    if listed.traceability:
        return _traceability(leads, as_json)
    if listed.manuals:
        return _manuals(chosen, as_json)
    judged = engines or [read_run(run).engine.name for run in runs] or ("env",)
    with _folder(out, judged, whole=not names) as folder:
        places = [run.resolve() if folders.is_link(run) else run for run in runs]  # the link may change
        answers = [(_with_probes(read_run(run), run, folder), run) for run in places]
        answers += [
            _answers(engine, chosen, cases, not names, folder, processes(jobs), as_json)
            for engine in engines or (() if runs else ("env",))
        ]
        found = page.judge_runs(chosen, answers, known, level.level)
        text, html = page.document(found.columns), folder / "claims.html"
        write_atomically(folder / "claims.json", text)
        write_atomically(html, page.write(found.columns, leads, html, found.headline))
        if as_json:
            click.echo(text, nl=False)
        else:
            _show(found.columns, found.unforeseen)
            click.echo(f"page: {html}")
            shared.say(found.headline)
        return found.exit_code


@contextmanager
def _folder(out: Path | None, engines: Sequence[str], whole: bool) -> Iterator[Path]:
    """Yield the folder of the page: the given one, or a new one among those of all claims or of some."""
    from lammps_cases.records import folders

    if out is not None:
        shared.page_folder(out)
        yield out
        return
    shelf = (folders.whole_claims if whole else folders.parts_of_claims)(shared.REPORTS)
    with shelf.place(*engines) as folder:
        yield folder


def _manuals(chosen: Sequence[Claim], as_json: bool) -> int:
    from eos_ref.syntax.manual import MANUALS

    some = [claim for claim in chosen if not all(claim.made_in(manual) for manual in MANUALS)]
    rows = [{"id": c.id, "since": c.since, "until": c.until, "section": c.section, "text": c.text} for c in some]
    if as_json:
        shared.show_document({"manuals": MANUALS, "claims": rows})
        return 0
    counts = ", ".join(f"{manual}: {sum(claim.made_in(manual) for claim in chosen)} claims" for manual in MANUALS)
    click.echo(f"{counts}; {len(some)} not in every one")
    shared.table(("claim", "since", "until", "text"), [(c.id, c.since, c.until, c.text) for c in some], prose=("text",))
    return 0


def _answers(
    engine: str, chosen: Sequence[Claim], cases: Sequence[Case], everything: bool, out: Path, jobs: int, quiet: bool
) -> tuple[RunRecord, Path]:
    """Run the cases and probes of some claims on an engine.

    Returns
    -------
    tuple of RunRecord and Path
        The record of both, and the folder with the report of the cases.
    """
    from lammps_cases.claims.probes import manual
    from lammps_cases.claims.verdicts import Names
    from lammps_cases.comparison.store import open_store
    from lammps_cases.engine import installations
    from lammps_cases.engine.workers import Workers
    from lammps_cases.records.files import write_atomically
    from lammps_cases.records.folders import folder_name
    from lammps_cases.run import campaign, provenance

    resolved = installations.resolve(engine)
    names = Names([case.name for case in cases] + [probe.name for probe in manual.probes()])
    wanted = {name for claim in chosen for name in names.of(claim)}
    needed = [case for case in cases if case.name in wanted]
    probes = [probe for probe in manual.probes() if everything or probe.name in wanted]
    folder = out / folder_name(engine)
    with Bar(quiet, prefix=f"{engine}: ") as bar:
        run = None
        if needed:
            asked, store = campaign.Request(provenance.command_line()), open_store()
            run = campaign.run_cases(needed, resolved, jobs, folder, asked, bar, store)
        with Workers(resolved.site, jobs) as workers:
            who = workers.outcome(workers.identify())
            record = provenance.engine_record(resolved, who)
            probed = provenance.run_record(record, provenance.command_line())
            said = [probe for probe in probes if probe.made_in(record.manual)]
            probed.cases = manual.put(said, workers, bar)
    write_atomically(_probes_file(folder), probed.counted().to_json())
    run = run or probed.model_copy(update={"cases": []})
    return run.model_copy(update={"cases": [*run.cases, *probed.cases]}), folder


def _probes_file(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}{PROBES}")


def _with_probes(run: RunRecord, folder: Path, out: Path) -> RunRecord:
    """Add to a finished run the probes that an earlier call of this command ran on the same LAMMPS."""
    from lammps_cases.records import folders
    from lammps_cases.records.run_record import RunRecord

    last = folders.whole_claims(shared.REPORTS).link
    for path in (_probes_file(folder), *sorted(out.glob(f"*{PROBES}")), *sorted(last.glob(f"*{PROBES}"))):
        try:
            probed = RunRecord.model_validate_json(path.read_bytes())
        except (OSError, ValueError):
            continue
        if probed.engine.library_sha256 == run.engine.library_sha256:
            return run.model_copy(update={"cases": [*run.cases, *probed.cases]})
    return run


def _show(columns: Sequence[Column], unforeseen: Sequence[tuple[str, CaseRecord]]) -> None:
    """List the claims that do not hold, and probes without a claim that ended in an unforeseen way, by engine."""
    from lammps_cases.claims.verdicts import counts, in_words
    from lammps_cases.records.wording import counted, listed

    for column in columns:
        totals = ", ".join(f"{count} {in_words(count, verdict)}" for verdict, count in counts(column.judged).items())
        click.secho(f"{column.engine}: {counted(len(column.judged), 'claim')}: {totals}", bold=True)
        for judged in column.judged:
            if judged.verdict == "does not hold":
                first, *rest = judged.evidence
                by = listed(first.findings) or (
                    "no finding explains it" if judged.unexplained else "by the page itself"
                )
                text = first.text if len(first.text) <= MOST_TEXT else f"{first.text[: MOST_TEXT - 3]}..."
                more = f" (and {len(rest)} more)" if rest else ""
                click.secho(f"  {judged.claim.id}: {judged.claim.text}", fg="red" if judged.unexplained else None)
                click.echo(f"    {by}: {first.case}: {text}{more}" if first.case else f"    {by}: {text}")
    for label, case in unforeseen:
        click.secho(f"  {label}: {case.case}: {case.message}", fg="red")


def _traceability(leads: Trace, as_json: bool) -> int:
    """List the missing links; return 1 if any has no reason."""
    if as_json:
        shared.show_document(asdict(leads))
        return int(not leads.complete)
    for title, names in (("claims without a case", leads.untestable), ("cases without a claim", leads.unclaimed)):
        click.secho(f"{len(names)} {title}", bold=True)
        for name, why in names.items():
            click.echo(f"  {name}: {why or 'no reason given'}")
    for id, patterns in leads.dangling.items():
        click.secho(f"  {id}: no case matches {', '.join(patterns)}", fg="red")
    for pattern in leads.stale:
        click.secho(f"  {pattern}: a reason for cases that have a claim, or do not exist", fg="red")
    return int(not leads.complete)
