"""eos-ref explain: a case, a particle of it, a finding, a field or a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import Json, command
from lammps_cases.records.options import Option, Positional
from lammps_cases.run.options import Files, paths

if TYPE_CHECKING:
    from lammps_cases.comparison.pair_sums import Sum
    from lammps_cases.engine.session import Job
    from lammps_cases.scene.atoms import Atoms
    from lammps_cases.scene.casefile import Case

DIGITS = 6  # of the numbers of a particle and its pairs


@command()
def explain_command(
    name: Annotated[str, Positional(metavar="CASE|FINDING|FIELD|VERDICT", complete="findings_and_cases")],
    atom: Annotated[
        int | None, Option("Show the neighbours of a particle, and what each pair adds to it.", metavar="ID")
    ] = None,
    step: Annotated[
        int | None, Option("For --atom: after N steps.  [default: the last that is compared]", metavar="N")
    ] = None,
    full: Annotated[
        bool, Option("Also show all changes of the reference it sees, what is modelled and why, and LAMMPS' commands.")
    ] = False,
    files: Files = (),
    as_json: Json = False,
) -> int:
    """Show a case: its scene, laws, bounds and what it exercises; with --full what is modelled and LAMMPS' input.

    It exercises the changes of the reference that move a field it compares out of its bound; --full tries all of the
    catalogue, in seconds to minutes. Several cases are listed; --full and --json show each. For a finding, a field or a
    verdict, say what it is.

    \b
    Example:  eos-ref explain near-rho0
              eos-ref explain near-rho0.tait-water.2d --full
              eos-ref explain forces.all.quintic.2d --atom 5 --step 1
              eos-ref explain surface/divr
    """
    from eos_ref.errors import InputError
    from lammps_cases.findings import LEDGER
    from lammps_cases.records.wording import MEANINGS
    from lammps_cases.scene import casefile
    from lammps_cases.scene.fields import FIELDS

    if step is not None and atom is None:
        raise InputError("option --step", "is that of a particle: --atom ID --step N")
    cases = casefile.load(paths(files))
    others = {**{entry.id: _finding for entry in LEDGER}, **dict.fromkeys(FIELDS, _field)}
    others |= dict.fromkeys(MEANINGS, _verdict)
    if not casefile.names_like(name, cases):
        if name not in others:
            known = dict.fromkeys(case.name.split(".")[0] for case in cases)
            every = [*others, *known, *(case.name for case in cases)]
            raise casefile.unknown_case("case, finding, field or verdict", name, every)
        if atom is not None:
            raise InputError("option --atom", "is that of a particle of a case", name)
        others[name](name, as_json)
        return 0
    selected = casefile.select(cases, (name,))
    if atom is not None:
        _particle(selected, atom, step, as_json)
        return 0
    if name in others and not as_json:  # a field or a verdict that is also a prefix of cases
        others[name](name, as_json)
    if len(selected) > 1 and not (full or as_json):
        _list(selected)
    elif as_json:
        shared.show_document({"cases": [_explanation(case, full) for case in selected]})
    else:
        for explanation in [_explanation(case, full) for case in selected]:
            _show(explanation, full)
    return 0


def _finding(name: str, as_json: bool) -> None:
    from lammps_cases.cli import findings

    findings.say((name,), as_json)


def _field(name: str, as_json: bool) -> None:
    """Describe a field, the stage of a step that computes it, and its output in LAMMPS."""
    from lammps_cases.scene.fields import FIELDS

    field = FIELDS[name]
    about, keyword = field.quantity.about, field.quantity.keyword
    shown = f"compute rheo/property/atom {field.column}" if field.column else field.compute or f"array {field.array}"
    kind = ("scalar", "vector", "tensor")[field.quantity.rank]
    if as_json:
        named = {"field": name, "about": about, "kind": kind, "stage": field.stage}
        shared.show_document(named | {"shown_by": shown, "needs": keyword})
        return
    needs = f"; needs fix rheo ... {keyword}" if keyword else ""
    shared.show(f"{name}: {about} ({kind}), of the stage {field.stage}; LAMMPS: {shown}{needs}", "  ")


def _verdict(name: str, as_json: bool) -> None:
    from lammps_cases.records.wording import MEANINGS

    meaning: str = {str(verdict): text for verdict, text in MEANINGS.items()}[name]
    if as_json:
        shared.show_document({"verdict": name, "meaning": meaning})
    else:
        shared.show(f"{name}: {meaning}", "  ")


def _explanation(case: Case, full: bool) -> dict[str, Any]:
    from eos_ref.eos import bounds
    from lammps_cases.comparison.predictor import Predictor
    from lammps_cases.comparison.store import open_store
    from lammps_cases.run.prepared_case import prepare
    from lammps_cases.setup import twins
    from lammps_cases.setup.plan import plan
    from lammps_cases.verdict import exercise, problems

    ready, the_plan, scene = prepare(case), plan(case.scene), case.scene
    laws = [
        {
            "type": t,
            **{name: getattr(law, name) for name in ("style", "rho0", "cs", "parameter", "background")},
            "defined": [str(end) for end in law.defined],
            "monotone": [str(end) for end in law.monotone],
            "bound": bounds.comparison_derivation(law),
        }
        for t, law in enumerate(ready.eos.laws if ready.eos else (), 1)
    ]
    return {
        "case": case.name,
        "about": case.about,
        "source": str(case.source),
        "particles": len(ready.atoms),
        "compared": _compared(case),
        "expects": scene.expect.refused if scene.expect else None,
        "laws": laws,
        "evaluated_by": problems.evaluated_by(case, ready.atoms),
        "reference": [asdict(item) for item in the_plan.reference],
        "lammps": [asdict(item) for item in the_plan.lammps],
        "exercises": exercise.rows(case, ready.eos, ready.atoms, Predictor(open_store()), full),
        "stability": _stability(case, ready.atoms),
        "twin": twins.describe(scene.twin) if scene.twin else None,
        "commands": _commands(ready.jobs[0]),
        "commands_of_twin": _commands(ready.jobs[1]) if scene.twin else None,
    }


def _compared(case: Case) -> str | None:
    """Return the names and steps of the compared fields; None if LAMMPS is to refuse the scene."""
    steps = case.scene.snapshots
    when = f" at step{'s' * (len(steps) > 1)} {', '.join(map(str, steps))}" if steps != (0,) else ""
    return None if case.scene.expect else f"compared{when}: {', '.join(case.scene.compare)}"


def _stability(case: Case, atoms: Atoms) -> list[str]:
    """Return the distance of the scene from failure."""
    from lammps_cases.setup import reference_side
    from lammps_cases.studies.stability.advice import advice

    scene = case.scene
    if scene.expect or not scene.interacts:
        return []
    timestep = scene.evolve.timestep if scene.evolve and scene.evolve.steps else None
    model, state = reference_side.model(scene, atoms, case.where), reference_side.state(scene, atoms, case.where)
    return advice(model, reference_side.box(scene, atoms), state, timestep)


def _commands(job: Job) -> list[str]:
    """List the commands of a job; unusual ones between two runs have a remark."""
    from lammps_cases.engine.interlude import FOLDER, Interlude

    lines = [f"# on {job.ranks} ranks"] if job.ranks > 1 else []
    lines += [*job.setup, f"# {len(job.id_n)} particles; {', '.join(job.per_atom)}", *job.commands]
    remarks = {"given": "", "refused": "  # LAMMPS must refuse this", "for each atom": "  # for each atom"}
    for stretch in job.runs:
        if isinstance(stretch, Interlude):
            lines += [action.text.replace(FOLDER, ".") + remarks[action.how] for action in stretch.actions]
        else:
            lines.append(stretch.command)
    return lines


def _list(cases: Sequence[Case]) -> None:
    """List cases: what each of their files is for, then the laws of each case, and the changes that it must detect."""
    from lammps_cases.records.wording import counted

    for about in dict.fromkeys(case.about for case in cases):
        shared.show(about)
    columns = ("case", "laws", "exercises")
    rows = [(case.name, ", ".join(shared.laws(case)), ", ".join(case.exercises)) for case in cases]
    shared.table(columns, rows, counted(len(cases), "case"), drop=("laws",), prose=columns[2:])
    shared.show(f"next: eos-ref explain {cases[0].name}", "  ")


def _show(explanation: dict[str, Any], full: bool) -> None:
    click.secho(f"{explanation['case']}  ({explanation['particles']} particles, {explanation['source']})", bold=True)
    shared.show(explanation["about"])
    if explanation["expects"]:
        click.echo(f"LAMMPS is expected to refuse this scene with: {explanation['expects']}")
    if explanation["twin"]:
        click.echo(f"Compared with a second run of LAMMPS, its twin. {explanation['twin']}")
    if explanation["compared"]:
        shared.show(explanation["compared"], "  ")
    for law in explanation["laws"]:
        parameters = ", ".join(f"{k} {law[k]}" for k in ("rho0", "cs", "parameter", "background") if law[k] is not None)
        click.echo(f"type {law['type']}: {law['style']}, {parameters}")
        everywhere = law["monotone"] == ["-inf", "inf"]
        click.echo(f"  grows with density {'everywhere' if everywhere else 'within ' + ' to '.join(law['monotone'])}")
        shared.show(f"  bound: {law['bound']}", "    ")
    if full and explanation["evaluated_by"]:
        click.echo(f"evaluated by {explanation['evaluated_by']}")
    if explanation["stability"]:
        click.echo("stability:")
        for line in explanation["stability"]:
            shared.show(f"  {line}", "    ")
    _show_changes(explanation["exercises"], full)
    if full:
        _show_sides(explanation)
    else:
        shared.show("--full also shows all changes that it sees, what is modelled and why, and LAMMPS' commands", "  ")


def _show_changes(exercises: Sequence[dict[str, Any]], full: bool) -> None:
    """Show the changes that a case must detect, or all that it detects."""
    from lammps_cases.records.wording import counted

    columns = ("required", "change", "moves", "the reference, changed")
    rows = [
        ("yes" if row["for"] else "", row["change"], counted(row["moved"], "particle"), row["what"])
        for row in exercises
    ]
    if rows:
        title = f"{'all ' * full}changes of the reference that move a field out of its bound"
        at = 0 if full else 1
        shared.table(columns[at:], [row[at:] for row in rows], title, drop=columns[2:3], prose=columns[3:])


def _show_sides(explanation: dict[str, Any]) -> None:
    for side, title in (("reference", "modelled by the reference"), ("lammps", "given to LAMMPS")):
        rows = [("yes" if item["needed"] else "no", item["name"], item["why"]) for item in explanation[side]]
        shared.table(("", "what", "why"), rows, title, prose=("why",))
    for title, key in (("LAMMPS commands:", "commands"), ("LAMMPS commands of the twin:", "commands_of_twin")):
        if explanation[key]:
            click.echo("\n".join([title, *(f"  {line}" for line in explanation[key])]))


def _particle(cases: Sequence[Case], atom: int, step: int | None, as_json: bool) -> None:
    """Show the neighbours of a particle by the reference, and what each pair adds to its force, density and heat.

    Raises
    ------
    InputError
        More than one case, one without interacting particles, an id or a step that does not exist.
    """
    import numpy as np

    from eos_ref.errors import InputError
    from lammps_cases.comparison.pair_sums import added_up, terms
    from lammps_cases.records.wording import some
    from lammps_cases.run.prepared_case import prepare
    from lammps_cases.verdict.problems import problem_of

    if len(cases) != 1:
        such = some([case.name for case in cases], 2)
        raise InputError("option --atom", f"needs a single case, but {len(cases)} match", such)
    (case,) = cases
    compared = case.scene.snapshots
    if case.scene.expect or not case.scene.interacts:
        raise InputError("case", "must have particles that interact", case.name, "option --atom")
    if step is not None and step not in compared:
        raise InputError("step", f"must be one that is compared: {', '.join(map(str, compared))}", step)
    step = compared[-1] if step is None else step
    scene, atoms = prepare(case).sides[0]
    if atom not in atoms.id_n:
        raise InputError("atom", f"must be an id of the {len(atoms)} particles", atom, "option --atom")
    if not np.array_equal(atoms.id_n, np.arange(1, len(atoms) + 1)):
        raise InputError("case", "must number its particles from 1 on", case.name, "option --atom")
    given = terms(problem_of(scene, atoms, case.where, compared), step, atom, len(atoms) ** 2, True)
    if as_json:
        run = {"run": "original"} if case.scene.twin else {}
        sums = {"sum": added_up(given.pairs)}
        shared.show_document({"case": case.name, "step": step, **run, **asdict(given), **sums})
    else:
        _show_particle(case, given, step)


def _show_particle(case: Case, given: Sum, step: int) -> None:
    from lammps_cases.comparison.pair_sums import added_up
    from lammps_cases.records.wording import counted, number

    own, twin = given.particle, case.scene.twin
    mass, rho, pressure = (number(value, DIGITS) for value in (own.mass, own.rho, own.pressure))
    where, kind = ", ".join(number(x, DIGITS) for x in own.x), "solid" if own.solid else "fluid"
    click.secho(f"{case.name}, particle {own.id} after {counted(step, 'step')}", bold=True)
    shared.show(
        f"type {own.type}, {kind}, at {where}; m {mass}, rho {rho}, P {pressure}; {counted(given.count, 'neighbour')}"
    )
    if twin:
        shared.show(f"of the original of the two runs that are compared; {twin.kind} makes the other, its twin")
    sums, axes = added_up(given.pairs), "xyz"[: len(own.x)] if "force" in added_up(given.pairs) else ""
    names: dict[str, tuple[str, int | None]] = {f"f_{axis}": ("force", k) for k, axis in enumerate(axes)}
    of_pressure = {f"of pressure {axis}": ("pressure_force", k) for k, axis in enumerate(axes)}
    names |= of_pressure
    names |= {name: (name, None) for name in ("drho", "heat") if name in sums}
    rows = [
        [str(pair.other.id), str(pair.other.type), "solid" if pair.other.solid else "fluid"]
        + [number(pair.r, DIGITS), number(pair.w, DIGITS)]
        + [number(_part(asdict(pair), *at), DIGITS) for at in names.values()]
        for pair in given.pairs
    ]
    rows.append(["sum", "", "", "", "", *(number(_part(sums, *at), DIGITS) for at in names.values())])
    columns = ["particle", "type", "phase", "r", "W", *names]
    shared.table(columns, rows, drop=["type", "phase", "W", *of_pressure, "r"])
    if given.force_with_fixes:
        force = ", ".join(number(of, DIGITS) for of in given.force_with_fixes)
        shared.show(f"force with the fixes of the case that add to it or set it: {force}")


def _part(of: dict[str, Any], name: str, axis: int | None) -> float | None:
    value: Any = of[name]
    return None if value is None else float(value if axis is None else value[axis])
