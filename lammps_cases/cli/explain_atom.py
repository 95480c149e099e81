"""eos-ref explain CASE --atom ID."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import click
import numpy as np

from eos_ref.errors import InputError
from lammps_cases.cli import shared
from lammps_cases.comparison.pair_sums import Sum, added_up, terms
from lammps_cases.records.wording import counted, number, some
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict.problems import problem_of

DIGITS = 6


def say(cases: Sequence[Case], atom: int, step: int | None, as_json: bool) -> None:
    """Show the neighbours of a particle by the reference, and what each pair adds to its force, density and heat.

    Raises
    ------
    InputError
        More than one case, one without particles that interact, an id or a step that it has not.
    """
    if len(cases) != 1:
        such = some([case.name for case in cases], 2)
        raise InputError("option --atom", f"needs a single case, but {len(cases)} match", such)
    (case,) = cases
    given = _sum(case, atom, _step(case, step))
    if as_json:
        document = {
            "case": case.name,
            "step": _step(case, step),
            **_run(case),
            **asdict(given),
            "sum": added_up(given.pairs),
        }
        click.echo(json.dumps(document, indent=1))
    else:
        _show(case, given, _step(case, step))


def _step(case: Case, step: int | None) -> int:
    scene = case.scene
    if scene.expect or not scene.interacts:
        raise InputError("case", "must have particles that interact", case.name, "option --atom")
    if step is not None and step not in scene.snapshots:
        raise InputError("step", f"must be one that is compared: {', '.join(map(str, scene.snapshots))}", step)
    return scene.snapshots[-1] if step is None else step


def _sum(case: Case, atom: int, step: int) -> Sum:
    scene, atoms = prepare(case).sides[0]
    if atom not in atoms.id_n:
        raise InputError("atom", f"must be an id of the {len(atoms)} particles", atom, "option --atom")
    if not np.array_equal(atoms.id_n, np.arange(1, len(atoms) + 1)):
        raise InputError("case", "must number its particles from 1 on", case.name, "option --atom")
    return terms(problem_of(scene, atoms, case.where, scene.snapshots), step, atom, len(atoms) ** 2, True)


def _run(case: Case) -> dict[str, str]:
    """Return which of the two runs of a twin is shown."""
    return {"run": "original"} if case.scene.twin else {}


def _show(case: Case, given: Sum, step: int) -> None:
    own, twin = given.particle, case.scene.twin
    where = ", ".join(number(x, DIGITS) for x in own.x)
    kind = "solid" if own.solid else "fluid"
    click.secho(f"{case.name}, particle {own.id} after {counted(step, 'step')}", bold=True)
    shared.show(
        f"type {own.type}, {kind}, at {where}; m {number(own.mass, DIGITS)}, rho {number(own.rho, DIGITS)}, "
        f"P {number(own.pressure, DIGITS)}; {counted(given.count, 'neighbour')}"
    )
    if twin:
        shared.show(f"of the original of the two runs that are compared; {twin.kind} makes the other, its twin")
    sums, axes = added_up(given.pairs), "xyz"[: len(own.x)]
    names: dict[str, tuple[str, int | None]]
    names = {f"f_{axis}": ("force", k) for k, axis in enumerate(axes)} if "force" in sums else {}
    pressure = {f"of pressure {axis}": ("pressure_force", k) for k, axis in enumerate(axes)} if "force" in sums else {}
    names |= pressure
    names |= {name: (name, None) for name in ("drho", "heat") if name in sums}
    rows = [
        [str(pair.other.id), str(pair.other.type), "solid" if pair.other.solid else "fluid"]
        + [number(pair.r, DIGITS), number(pair.w, DIGITS)]
        + [number(_part(asdict(pair), *at), DIGITS) for at in names.values()]
        for pair in given.pairs
    ]
    rows.append(["sum", "", "", "", "", *(number(_part(sums, *at), DIGITS) for at in names.values())])
    shared.table(
        ["particle", "type", "phase", "r", "W", *names], rows, drop=["type", "phase", "W", *pressure, "r"]
    )  # fmt: skip
    if given.force_with_fixes:
        force = ", ".join(number(of, DIGITS) for of in given.force_with_fixes)
        shared.show(f"force with the fixes of the case that add to it or set it: {force}")


def _part(of: dict[str, Any], name: str, axis: int | None) -> float | None:
    value: Any = of[name]
    return None if value is None else float(value if axis is None else value[axis])
