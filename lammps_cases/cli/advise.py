"""eos-ref advise: the numbers of a flow, each with its reason, and the deck or scene with them."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from lammps_cases.audit.options import TRUST, AuditOptions, Given, trusted
from lammps_cases.cli import shared
from lammps_cases.cli.audit import AsLammps
from lammps_cases.cli.commands import Json, command
from lammps_cases.records.options import Option, Positional
from lammps_cases.records.wording import number
from lammps_cases.run.options import EngineName, Files, paths

if TYPE_CHECKING:
    from lammps_cases.studies.stability.choice import AdvisedNumbers


@dataclass(frozen=True)
class SetUpOptions:
    """How LAMMPS sets up a deck; see `lammps_cases.audit.options.AuditOptions`."""

    trust: Annotated[bool, Option("Let DECK run programs, and read and write all your files.", envvar=TRUST)] = field(
        default_factory=trusted
    )
    root: Annotated[Path | None, Option("Copy DIR, for decks that read files of other folders.", metavar="DIR")] = None
    var: Annotated[
        Mapping[str, Any], Option("Define an index variable before DECK, as lmp.", "-v", "-var", type=str)
    ] = field(default_factory=dict)
    package: Annotated[tuple[str, ...], Option("As LAMMPS' own switch.", "-pk", "-package", multiple=False)] = ()


@command(cls=AsLammps)
def advise_command(
    name: Annotated[str, Positional(metavar="DECK|CASE", complete="cases")],
    compressibility: Annotated[float, Option("Fraction by which the density may vary.", metavar="D")] = 0.01,
    *,
    given: Given,
    write: Annotated[Path | None, Option("Write the deck, or the case, with these numbers.", metavar="FILE")] = None,
    files: Files = (),
    deck: SetUpOptions,
    engine: EngineName = "env",
    as_json: Json = False,
) -> int:
    """Choose time step, speed of sound, kernel, cutoff and zmin of a flow, and say what error and cost to expect.

    DECK is set up by LAMMPS, as by audit; its runs are not carried out. Each number has its formula with the numbers of
    this flow and what was measured: the maps of stability, flows with known solutions. Numbers are in the units of the
    deck. Without --write the change of the deck is shown.

    \b
    Example:  eos-ref advise in.deck
              eos-ref advise in.deck --speed 0.5 --compressibility 0.005 --write in.advised
              eos-ref advise fluids.unit --json
    """
    from eos_ref.errors import InputError
    from lammps_cases.audit import advised, flow_scales
    from lammps_cases.audit.supervise import described
    from lammps_cases.audit.text import LARGEST_SCRIPT
    from lammps_cases.engine import installations
    from lammps_cases.records.files import read_text, write_atomically
    from lammps_cases.records.wording import plain
    from lammps_cases.run.prepared_case import prepare
    from lammps_cases.scene import casefile
    from lammps_cases.studies.stability.choice import strictest
    from lammps_cases.studies.stability.limits import read

    if not 0 < compressibility < 1:
        raise InputError("compressibility", "must lie between 0 and 1", compressibility, "option --compressibility")
    place = Path(name)
    if place.is_file() and place.suffix not in (".yaml", ".yml"):
        site = installations.resolve(engine).site
        how = AuditOptions(trust=deck.trust, root=deck.root, var=deck.var, package=deck.package, engine=site)
        _, setups = described(place, how)
        choice = strictest(flow_scales.scales_of_deck(setups, given, name), compressibility, read())
        before, made = read_text(place, "deck", LARGEST_SCRIPT), partial(advised.advised_deck, place, setups)
    else:
        if place.parts[1:] and not place.exists():
            raise InputError("deck", "no such file", where=name)
        cases = casefile.load([place] if place.is_file() else paths(files))
        case = cases[0] if place.is_file() and len(cases) == 1 else casefile.only(cases, name)
        of = flow_scales.scales_of_scene(case.scene, prepare(case).atoms, given, case.name)
        choice = strictest([of], compressibility, read())
        before, made = advised.case_file(case), partial(advised.case_file, case)
    if write is not None:
        write_atomically(write, made(choice))
    if as_json:
        content = {"of": name, "flow": asdict(choice.flow), "limits": choice.limits, "fails": choice.fails}
        shared.show_document(plain(content | {"chosen": [asdict(line) for line in choice.chosen]}))
        return 0
    _show(name, choice)
    if write is not None:
        click.echo(f"written: {write}")
        return 0
    try:
        sides = (before.splitlines(), made(choice).splitlines())
    except InputError as error:
        shared.show(f"not shown as a change of the deck: {error}", "    ")
        return 0
    for line in difflib.unified_diff(*sides, name, f"{name}, advised", n=0, lineterm=""):
        click.echo(line)
    return 0


def _show(name: str, choice: AdvisedNumbers) -> None:
    of = choice.flow
    scales = {"U": of.speed, "L": of.length, "g H": of.head, "nu": of.nu, "spacing": of.spacing}
    flow = ", ".join(f"{key} {number(value)}" for key, value in scales.items())
    click.secho(f"{name}: like flow {of.like}, {of.dimension}D, {flow}", bold=True)
    for line in choice.chosen:
        now, new = (value if isinstance(value, str) else number(value) for value in (line.now, line.advised))
        values = " -> ".join(value for value in dict.fromkeys((now, new)) if value) or "see"
        shared.show(f"{line.subject}: {values or 'none'}  ({line.why})", "    ")
