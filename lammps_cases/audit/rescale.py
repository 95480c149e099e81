"""A deck rewritten in the unit of length in which m/rho0 is 1, which avoids a known bug in the forces of pairs.

LAMMPS leaves the volume out of the forces of pairs, so that accelerations are rho/m times what they should be. In d
dimensions a unit of length of (m/rho0)^(1/d) makes that rho/rho0; no physics depends on the unit.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.box import Box
from eos_ref.model.quantities import needed_to_step
from eos_ref.model.state import State
from eos_ref.numbers.rounded import Rounded, error, value
from eos_ref.syntax.manual import manual_of
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation
from lammps_cases.audit.messages import DeckSetups, RunSetup, StartState
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.sample import SOLID
from lammps_cases.audit.scaling import BEFORE_BOX, Scaling, kept_commands, needed_variables
from lammps_cases.audit.share import data
from lammps_cases.audit.supervise import audit_deck, described
from lammps_cases.audit.text import quoted
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.records.deck_wording import percent
from lammps_cases.records.files import write_atomically
from lammps_cases.records.progress import SILENT
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.wording import times
from lammps_cases.setup.twins import Scale

SKINS = {"lj": "0.3", "si": "0.001", "cgs": "0.1"}  # of neighbour lists by default; no other system is rescaled
SAME = 1e-12  # relative differences of m/rho0 between types that count as rounding
STIRRED = 0.1  # of the spacing, of the speed of sound, of energies
AT_SURFACE = 1  # the class of surface particles that have a normal
ROUNDINGS = 4  # at most, of a number on its way into the new deck
REPULSION = "in 2D the short-range repulsion by walls (interface/reconstruct, chi > 0.9) depends on the unit of length"
COLUMNS = ("x", "v", "f", "rho", "drho", "pressure", "energy")


@dataclass(frozen=True)
class RescaledDeck:
    """The lines of a rescaled deck and of its data file, with the reference's comparison of both decks.

    Attributes
    ----------
    volume : m/rho0 of the original deck
    length : new unit of length, in that of the original
    same : largest difference between the two decks' fields by the reference, over the bound, the particles stirred
    notes : what differs between them
    """

    commands: list[str]
    data: list[str]
    volume: float
    length: float
    same: float
    notes: list[str]


def rescale(deck: Path, options: AuditOptions, target: Path) -> list[str]:
    """Write a deck in the unit of length in which m/rho0 is 1, run it, and return lines about it.

    The new deck is checked in two ways: the reference's forces and rates of both decks, stirred equally, differ by no
    more than rounding; LAMMPS runs it, audited, to its end.

    Parameters
    ----------
    deck : Path
    options : AuditOptions
        Of the audit of the new deck.
    target : Path
        The new deck; its data file is in the same folder, with ``.data`` behind its name.

    Raises
    ------
    InputError
        A command or a state that cannot be rescaled with certainty; no unit of length makes m/rho0 1; the new deck
        does not run, or is not the same to the reference. Nothing is written.
    EngineMissing
    """
    _, setups = described(deck, options)
    made = rescaled(setups, deck.name, target.name)
    content, particles = ("\n".join([*lines, ""]) for lines in (made.commands, made.data))
    with tempfile.TemporaryDirectory(prefix="eos-ref-rescale-") as folder:
        copy = Path(folder) / target.name
        write_atomically(copy, content)
        write_atomically(_data_file(copy), particles)
        case = audit_deck(copy, replace(options, keep=None, progress=SILENT)).record.cases[0]
    if case.verdict not in ("exact", "pass", "explained", "differs"):
        raise InputError("rescaled deck", "must be run by LAMMPS to its end", case.engine_error or case.message)
    write_atomically(_data_file(target), particles)
    write_atomically(target, content)
    return _report(made, case, target)


def _data_file(deck: Path) -> Path:
    return deck.with_name(f"{deck.name}.data")


def _report(made: RescaledDeck, case: CaseRecord, target: Path) -> list[str]:
    left = [e.relative or 0.0 for e in case.effects if e.finding == FORCE_PER_VOLUME.id and e.field == "f"]
    differing = sorted({check.field for check in case.checks if check.verdict == "differs"})
    lines = [
        f"{target}: unit of length {made.length:.6g}, in which m/rho0 is 1 instead of {made.volume:.3g}; LAMMPS runs "
        f"it, {case.steps} steps, {case.natoms} atoms",
        f"same physics: forces and rates by the reference differ by {made.same:.2g} x bound; forces of pairs are "
        f"{times(1 / made.volume)} times too large in LAMMPS before, now off by at most "
        f"{percent(max(left, default=0.0))} % (rho/rho0 - 1)",
    ]
    lines += made.notes
    return lines + ([f"not explained in the new deck: {', '.join(differing)}"] if differing else [])


def rescaled(setups: DeckSetups, name: str, target: str) -> RescaledDeck:
    """Return the rescaled deck of a followed one.

    Raises
    ------
    InputError
    """
    run, start = setups.runs[0], setups.start
    if start is None:
        raise InputError("deck", "must have an atom_style of RHEO to be rescaled", where=name)
    if run.units not in SKINS:
        raise InputError("units", f"must be one of {', '.join(SKINS)} to be rescaled", run.units, name)
    if run.mass_t is None:
        raise InputError("deck", "must have masses of types to be rescaled, not of particles", where=name)
    deck = run.deck
    if deck.bonded:
        raise InputError("deck", "must have no bonds to be rescaled", deck.bonded[0], name)
    if not np.isfinite([start.x_nc, start.v_nc]).all():
        raise InputError("deck", "must begin with finite positions and velocities to be rescaled", where=name)
    before = sample_of(run, start)
    volume = _volume(before, name)
    length = float(f"{volume ** (1 / run.dimension):.15g}")  # a readable number, if any
    scale = Scale(run.dimension, 1 / length)
    scaling = Scaling(scale, manual_of(run.version))
    commands = list(_commands(setups, start, scaling, target))  # which refuses what cannot be scaled, with its line
    other = replace(deck, fixes={key: scaling.words(words) for key, words in deck.fixes.items()})
    other.pair = scaling.words(["pair_style", *deck.pair])[1:]
    start_there = _scaled_start(start, scale)
    stirred = _stirred(start, length, max(law.cs for law in before.model.eos.laws))
    same = _same(sample_of(run, stirred), sample_of(replace(run, deck=other), _scaled_start(stirred, scale)), scale)
    flat = run.dimension == 2 and before.model.fix.interface_reconstruct
    notes = [f"{REPULSION}: relative to other forces it is {1 / length:.6g} times what it was"] if flat else []
    head = [f"# {line}" for line in (*_header(volume, length, scale, name), *notes)]
    return RescaledDeck([*head, *commands], _data(start_there, run), volume, length, same, notes)


def _volume(sample: ParticleSample, name: str) -> float:
    """Return m/rho0, which is the same for all types that have particles."""
    model = sample.model
    types = sorted(set(sample.state.type_n.tolist()))
    volume_t = {t: model.mass_t[t - 1] / model.eos[t].rho0 for t in types}
    least, largest = min(volume_t.values()), max(volume_t.values())
    if largest - least > SAME * largest:
        found = ", ".join(f"{volume:.6g} of type {t}" for t, volume in volume_t.items())
        raise InputError("m/rho0", "must be the same for all types: a unit of length changes all equally", found, name)
    if abs(largest - 1) <= SAME:
        raise InputError("m/rho0", "is 1 already: no other unit of length is better", where=name)
    return float(largest)


def sample_of(run: RunSetup, start: StartState, followed: bool = True) -> ParticleSample:
    """Return the particles with which a run would begin, had the runs before it not moved them.

    Raises
    ------
    InputError
        No model that can be followed; if only what is ``followed`` may change forces, a fix that cannot be followed.
    """
    d, s, model = run.dimension, start, run.model()
    energy_n = s.energy_n if model.thermal is not None else None
    state = State(s.x_nc[:, :d], s.v_nc[:, :d], s.rho_n, s.type_n, s.status_n & SOLID != 0, energy_n)
    low_c, high_c = (tuple(end_c[:d].tolist()) for end_c in s.box_c)
    tilt = tuple(s.tilt_c[: d * (d - 1) // 2].tolist())
    box = Box(low_c, high_c, tuple(s.periodic[:d]), tilt if any(tilt) else ())
    acting = run.deck.actions() if followed else run.deck.plain_actions()
    actions = [(action, s.members[action.group]) for action in acting]
    return ParticleSample(model, box, state, model.mass[s.type_n - 1], actions)


# --- the same to the reference


class _Rounded(ParticleSample):
    """A sample with rounded numbers, as are those of its model."""

    def rounded(self) -> State:
        """Return the state with these errors; those of positions and velocities stand for the model's."""
        s, by = self.state, ROUNDINGS * EPS
        cs = max(law.cs for law in self.model.eos.laws)

        def off(values: Any, least: float = 0.0) -> Rounded:
            return Rounded(values, by * np.maximum(np.abs(values), least))

        energy_n = None if s.energy_n is None else off(s.energy_n)
        return State(off(s.x_nc, self.model.cut), off(s.v_nc, cs), off(s.rho_n), s.type_n, s.solid_n, energy_n)


def _stirred(start: StartState, spacing: float, cs: float) -> StartState:
    """Return a start in motion: on a lattice at rest no force would reveal a wrong number."""
    random = np.random.default_rng(0)

    def noise(like: Any) -> Any:
        return random.uniform(-STIRRED, STIRRED, like.shape)

    x_nc = start.x_nc + spacing * noise(start.x_nc) * np.ptp(start.x_nc, axis=0).astype(bool)
    return replace(
        start,
        x_nc=x_nc,
        v_nc=start.v_nc + cs * noise(start.v_nc),
        rho_n=start.rho_n * (1 + STIRRED * noise(start.rho_n)),
        energy_n=start.energy_n * (1 + noise(start.energy_n)),
    )


def _repelling(by: float) -> type[ArrayEvaluator]:
    """Return the reference with another strength of the repulsion by walls."""

    class Repelling(ArrayEvaluator):
        def repulsion(self, chi_n: Any, sound: Any) -> Any:
            return by * super().repulsion(chi_n, sound)

    return Repelling


def _same(before: ParticleSample, after: ParticleSample, scale: Scale) -> float:
    """Return the largest difference between the reference's fields of two set-ups, over the bound.

    The repulsion by walls has the dimension of a force in 3D only (NUMERICS.md, section 5): it is compared as a force.
    Shifts at surfaces, whose normals are softened by a constant without a unit (section 4), are left out.

    Raises
    ------
    InputError
        It exceeds the bound.
    """
    fields = (*needed_to_step(before.model), "pressure")
    one = SampleEvaluation(before, fields)
    repelling = _repelling(scale.of("x") ** (scale.d - 3))
    other = SampleEvaluation(_Rounded(**vars(after)), fields, repelling)
    worst = 0.0
    for name in fields:
        rows_n = one.comparable(name) & other.comparable(name)
        if name == "shift/v" and "surface" in one.simulation.fields:
            rows_n &= value(one.simulation.fields["surface"]) != AT_SURFACE
        a, b = one.output(name), other.output(name)
        factor = scale.of(name)
        difference = np.abs(np.asarray(value(a), float) - np.asarray(value(b), float) / factor)[rows_n]
        bound = (np.asarray(error(a), float) + np.asarray(error(b), float) / factor)[rows_n]
        ratio = np.divide(difference, bound, out=np.zeros(difference.shape), where=difference > 0).max(initial=0.0)
        if not ratio <= 1:
            rule = f"must be the same to the reference: {name} differs by {ratio:.3g} x bound"
            raise InputError("rescaled deck", rule)
        worst = max(worst, float(ratio))
    return worst


# --- what is written


def _scaled_start(start: StartState, scale: Scale) -> StartState:
    return replace(
        start,
        box_c=start.box_c * scale.of("x"),
        tilt_c=start.tilt_c * scale.of("x"),
        x_nc=start.x_nc * scale.of("x"),
        v_nc=start.v_nc * scale.of("v"),
        rho_n=start.rho_n * scale.of("rho"),
        energy_n=start.energy_n * scale.of("energy"),
    )


def _data(start: StartState, run: RunSetup) -> list[str]:
    s, heat = start, bool(start.energy_n.size)
    atoms = (s.id_n, s.type_n, s.status_n, s.rho_n, *([s.energy_n] if heat else []), *s.x_nc.T)
    tilt_c = s.tilt_c if s.tilt_c.any() else None
    style = "rheo/thermal" if heat else "rheo"
    return data(atoms, (s.id_n, *s.v_nc.T), run.ntypes, style, s.box_c[0], s.box_c[1], tilt_c)


def _header(volume: float, length: float, scale: Scale, name: str) -> list[str]:
    outputs = ", ".join(f"{column} {1 / scale.of(column):.9g}" for column in COLUMNS)
    return [
        f"{name} in another unit of length: m/rho0 is 1 instead of {volume:.9g}, which avoids {FORCE_PER_VOLUME.id}",
        f"unit of length: {length!r} of the deck's; units of mass and time as in the deck",
        f"outputs times these factors are those of the deck: {outputs}",
        "formulas of variables are as they were; numbers in them are not rescaled",
    ]


def _commands(setups: DeckSetups, start: StartState, scaling: Scaling, target: str) -> Iterator[str]:
    kept = list(kept_commands(setups.script))
    for command in kept:
        if command.values[0] in BEFORE_BOX:
            yield _line(scaling.command(command))
    run = setups.runs[0]
    yield f"read_data {_data_file(Path(target)).name}"
    yield from (f"mass {t} {mass!r}" for t, mass in enumerate((run.mass_t or ())[1:], 1))
    yield from _groups(start)
    if run.first:
        yield f"reset_timestep {run.first}"
    if not any(command.values[0] == "neighbor" and not command.runs for command in kept):
        yield _line(scaling.words(["neighbor", SKINS[run.units], "bin"]))
    needed = needed_variables(kept)
    for command in kept:
        if command.values[0] == "variable":
            if command.values[1] in needed:
                yield _line(command.values)
        elif command.values[0] not in BEFORE_BOX:
            yield _line(scaling.command(command))


def _line(words: Sequence[str]) -> str:
    return " ".join(map(quoted, words))


def _groups(start: StartState) -> Iterator[str]:
    """Yield commands that define the groups: by types where possible, else by ids."""
    for name, in_n in start.members.items():
        if name == "all":
            continue
        types = np.unique(start.type_n[in_n])
        if not in_n.any():
            yield f"group {name} empty"
        elif np.array_equal(in_n, np.isin(start.type_n, types)):
            yield f"group {name} type {' '.join(map(str, types))}"
        else:
            id_n = np.sort(start.id_n[in_n])
            for part in np.split(id_n, np.flatnonzero(np.diff(id_n) != 1) + 1):
                yield f"group {name} id {part[0]}:{part[-1]}"
