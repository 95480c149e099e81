"""eos-ref explain."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import click

from lammps_cases.cli import shared
from lammps_cases.cli.commands import Json, command
from lammps_cases.records.options import Option, Positional
from lammps_cases.run.options import Files, paths

if TYPE_CHECKING:
    from lammps_cases.engine.session import Job
    from lammps_cases.scene.case import Scene
    from lammps_cases.scene.casefile import Case


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
        bool, Option("Also show all rules it exercises, what is modelled and why, and LAMMPS' commands.")
    ] = False,
    files: Files = (),
    as_json: Json = False,
) -> int:
    """Show a case: its scene, laws, bounds and the rules it exercises; with --full what is modelled and LAMMPS' input.

    The rules it exercises are counted by running the reference on it. Cases whose names begin alike are listed; --full
    and --json show each. For a finding, a field or a verdict, say what it is.

    \b
    Example:  eos-ref explain near-rho0
              eos-ref explain near-rho0.tait-water.2d --full
              eos-ref explain forces.all.quintic.2d --atom 5 --step 1
              eos-ref explain surface/divr
    """
    from eos_ref.errors import InputError, unknown
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
            raise unknown("case, finding, field or verdict", name, [*others, *known, *(case.name for case in cases)])
        if atom is not None:
            raise InputError("option --atom", "is that of a particle of a case", name)
        others[name](name, as_json)
        return 0
    if atom is not None:
        from lammps_cases.cli import explain_atom

        explain_atom.say(casefile.select(cases, (name,)), atom, step, as_json)
        return 0
    selected = casefile.select(cases, (name,))
    if name in others and not as_json:  # a field or a verdict that cases begin with, too
        others[name](name, as_json)
    if len(selected) > 1 and not (full or as_json):
        _list(selected)
        return 0
    explanations = [_explanation(case) for case in selected]
    if as_json:
        click.echo(json.dumps({"cases": explanations}, indent=1))
        return 0
    for explanation in explanations:
        _show(explanation, full)
    return 0


def _finding(name: str, as_json: bool) -> None:
    """Say what a finding is, as the ledger does."""
    from lammps_cases.cli import findings

    findings.say((name,), as_json)


def _field(name: str, as_json: bool) -> None:
    """Say what a field is, which stage of a step makes it, and where LAMMPS shows it."""
    from lammps_cases.scene.fields import FIELDS

    field = FIELDS[name]
    quantity = field.quantity
    shown = f"compute rheo/property/atom {field.column}" if field.column else field.compute or f"array {field.array}"
    said = {
        "field": name,
        "about": quantity.about,
        "kind": ("scalar", "vector", "tensor")[quantity.rank],
        "stage": field.stage,
        "shown_by": shown,
        "needs": quantity.keyword,
    }
    if as_json:
        click.echo(json.dumps(said, indent=1))
        return
    needs = f"; needs fix rheo ... {quantity.keyword}" if quantity.keyword else ""
    shared.show(f"{name}: {quantity.about} ({said['kind']}), of the stage {field.stage}; LAMMPS: {shown}{needs}", "  ")


def _verdict(name: str, as_json: bool) -> None:
    """Say what a verdict means."""
    from lammps_cases.records.wording import MEANINGS

    meaning: str = {str(verdict): text for verdict, text in MEANINGS.items()}[name]
    if as_json:
        click.echo(json.dumps({"verdict": name, "meaning": meaning}, indent=1))
    else:
        shared.show(f"{name}: {meaning}", "  ")


def _explanation(case: Any) -> dict[str, Any]:
    from dataclasses import asdict

    from eos_ref.eos import bounds
    from lammps_cases.run.prepared_case import prepare
    from lammps_cases.setup import twins
    from lammps_cases.setup.plan import plan

    ready, the_plan = prepare(case), plan(case.scene)
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
        "compared": _compared(case.scene),
        "expects": case.scene.expect.refused if case.scene.expect else None,
        "laws": laws,
        "evaluated_by": _evaluator(case, ready),
        "reference": [asdict(item) for item in the_plan.reference],
        "lammps": [asdict(item) for item in the_plan.lammps],
        "exercises": _exercises(case, ready),
        "stability": _stability(case, ready),
        "twin": twins.describe(case.scene.twin) if case.scene.twin else None,
        "commands": _commands(ready.jobs[0]),
        "commands_of_twin": _commands(ready.jobs[1]) if case.scene.twin else None,
    }


def _compared(scene: Scene) -> str | None:
    """Name the fields that are compared, and at which steps; None where LAMMPS is to refuse the scene."""
    if scene.expect:
        return None
    steps = scene.snapshots
    when = f" at step{'s' * (len(steps) > 1)} {', '.join(map(str, steps))}" if steps != (0,) else ""
    return f"compared{when}: {', '.join(scene.compare)}"


def _evaluator(case: Any, ready: Any) -> str | None:
    """Name the body of the reference that judges a case, and the size that decides it."""
    from eos_ref.evaluation.array_evaluator import ArrayEvaluator
    from lammps_cases.comparison.trajectory import COMPILED_ABOVE, evaluations, own_stages
    from lammps_cases.verdict.problems import problem_of

    scene = case.scene
    if scene.expect:
        return None
    if not scene.whole_model:
        return "the formula of the law, in numpy"
    problem = problem_of(scene, ready.atoms, case.where, scene.snapshots)
    name = "array" if issubclass(own_stages(problem), ArrayEvaluator) else "compiled"
    return f"the {name} evaluator ({evaluations(problem)} evaluations of a particle; compiled above {COMPILED_ABOVE})"


def _exercises(case: Any, ready: Any) -> list[dict[str, Any]]:
    """List the rules that a case is for, then those it takes besides, with the number of particles or pairs of each."""
    from lammps_cases.comparison.prediction_keys import open_store
    from lammps_cases.comparison.predictor import Predictor
    from lammps_cases.scene.rules import RULES
    from lammps_cases.verdict import problems

    taken = problems.counts(case, ready.atoms, Predictor(open_store()))
    names = [*case.exercises, *(name for name in RULES if name in taken and name not in case.exercises)]
    return [
        {
            "rule": name,
            "sentence": RULES[name].sentence,
            "count": taken.get(name, 0),
            "of": RULES[name].of,
            "for": name in case.exercises,
        }
        for name in names
    ]


def _stability(case: Any, ready: Any) -> list[str]:
    """Say how far the scene lies from where it would fail."""
    from lammps_cases.setup import reference_side
    from lammps_cases.studies.stability.advice import advice

    scene, atoms = case.scene, ready.atoms
    if scene.expect or not scene.interacts:
        return []
    timestep = scene.evolve.timestep if scene.evolve and scene.evolve.steps else None
    model, box = reference_side.model(scene, atoms, case.where), reference_side.box(scene, atoms)
    return advice(model, box, reference_side.state(scene, atoms, case.where), timestep)


def _commands(job: Job) -> list[str]:
    """List the commands of a job; those between two runs that are no plain ones have a remark."""
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
    """List cases: what each file of theirs is for, then the laws of each case, and the rules that it is for."""
    from lammps_cases.records.wording import counted

    for about in dict.fromkeys(case.about for case in cases):
        shared.show(about)
    columns = ("case", "laws", "rules exercised")
    rows = [
        (case.name, ", ".join(dict.fromkeys(law.style for law in case.scene.pressure)), ", ".join(case.exercises))
        for case in cases
    ]
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
    _show_rules(explanation["exercises"], full)
    if full:
        _show_sides(explanation)
        return
    besides = sum(not row["for"] for row in explanation["exercises"])
    rules = "rule" if besides == 1 else "rules"
    rest = f"the {besides} other {rules} it exercises, what" if besides else "what"
    shared.show(f"--full also shows {rest} is modelled and why, and LAMMPS' commands", "  ")


def _show_rules(exercises: Sequence[dict[str, Any]], full: bool) -> None:
    """Show the rules that a case is for, or all that it takes."""
    from lammps_cases.records.wording import counted

    columns = ("purpose", "rule", "exercised by", "what the reference does")
    rows = [
        ("yes" if row["for"] else "", row["rule"], counted(row["count"], row["of"]), row["sentence"])
        for row in exercises
        if full or row["for"]
    ]
    if rows:
        title = f"{'all ' * full}rules exercised (counted on the reference)"
        at = 0 if full else 1
        shared.table(columns[at:], [row[at:] for row in rows], title, drop=columns[2:3], prose=columns[3:])


def _show_sides(explanation: dict[str, Any]) -> None:
    """Show what is modelled, what LAMMPS is told, and why."""
    for side in ("reference", "lammps"):
        rows = [("yes" if item["needed"] else "no", item["name"], item["why"]) for item in explanation[side]]
        title = "modelled by the reference" if side == "reference" else "told to LAMMPS"
        shared.table(("", "what", "why"), rows, title, prose=("why",))
    click.echo("LAMMPS commands:")
    click.echo("\n".join(f"  {line}" for line in explanation["commands"]))
    if explanation["commands_of_twin"]:
        click.echo("LAMMPS commands of the twin:")
        click.echo("\n".join(f"  {line}" for line in explanation["commands_of_twin"]))
