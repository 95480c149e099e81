"""The columns of a dump by its deck, with their digits, and a snapshot as a sample.

A dump is written at the end of a step, half a step after the forces: velocities have moved on by half a step of f/m,
densities of fluid by half a step of the rate of the continuity equation, energies by half a step of the heat flow. All
are taken back with the columns of the dump, so that only what it holds is compared. Positions and phases are
those of the forces; the pressure and the total stress are those of the densities and energies of the dump itself. On
the set-up of a run nothing has moved on.
"""

from __future__ import annotations

import fnmatch
import itertools
import re
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.pairs import directed_pairs
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model
from eos_ref.model.quantities import QUANTITIES, dependencies
from eos_ref.model.state import Gradients, State
from eos_ref.numbers.elementary import where
from eos_ref.numbers.rounded import Rounded, error, value
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation
from lammps_cases.audit.fields import needs
from lammps_cases.audit.messages import DeckDump, RunSetup
from lammps_cases.scene.fields import FIELDS
from lammps_cases.scene.lammps_files import FileSnapshot

FORMAT = re.compile(r"%[-+ 0#]*[0-9]*(?:\.([0-9]+))?l?([eEfFgG])")
PLACES = ("unwrapped", "scaled")  # positions other than x y z: shifted by whole edges, or in fractions of the edges
DEFAULT = "%g"  # by the manual, of dump custom
EXACT = {"e": 16, "g": 17}  # digits (e: after the point) from which on every double has its own text
OF_ATOM = {"drho": "drho", "viscosity": "viscosity", "rho": "rho", "rheo_status": "status"}  # compute property/atom
NAMED = {
    "x": "columns x y z",
    "v": "columns vx vy vz",
    "f": "columns fx fy fz",
    "mass": "a column mass",
    "drho": "a column of drho (compute property/atom)",
}
OF_GRADIENT = ("viscosity", "stress/v", "stress/t")  # follow from the velocity gradient, particle by particle


class Component(NamedTuple):
    """A component of a quantity, by its number in the order of `numpy.ndarray.ravel`."""

    quantity: str
    component: int


@dataclass(frozen=True)
class DumpColumns:
    """The columns of a dump: their names in the file, their content if known, and the format of each."""

    dump: DeckDump
    names: tuple[str, ...]
    parts: tuple[Component | None, ...]
    formats: tuple[str, ...]

    def read(self, snapshot: FileSnapshot, dimension: int) -> dict[str, Rounded]:
        """Return the quantities of a snapshot all of whose components are there, with the error of their digits.

        Raises
        ------
        InputError
            A column that does not hold numbers, or no finite ones.
        """
        components: dict[str, dict[int, Rounded]] = {}
        for name, part, form in zip(self.names, self.parts, self.formats, strict=True):
            if part is not None:
                printed = "%.17g" if snapshot.exact else form
                components.setdefault(part.quantity, {})[part.component] = number(snapshot.numbers(name), printed)
        whole: dict[str, Rounded] = {}
        for quantity, parts in components.items():
            rank = (
                1
                if quantity in ("x", "v", "f", *PLACES)
                else QUANTITIES[quantity].rank
                if quantity in QUANTITIES
                else 0
            )
            shape = (dimension,) * rank
            if all(k in parts for k in range(dimension**rank)):
                stacked = [np.stack([getattr(parts[k], side) for k in range(dimension**rank)], axis=1)
                           for side in ("value", "error")]  # fmt: skip
                whole[quantity] = Rounded(*(side.reshape(-1, *shape) for side in stacked))
        for form in PLACES:
            if (place_nc := whole.pop(form, None)) is not None:
                whole.setdefault("x", _positions(place_nc, form, snapshot, dimension))
        return whole


def _positions(place_nc: Rounded, form: str, snapshot: FileSnapshot, dimension: int) -> Rounded:
    """Return positions, (n, d), from fractions of the box's edges, or from unwrapped ones, which may lie outside.

    LAMMPS' numbers are off by the roundings of its conversion of positions: two operations with an edge.
    """
    d = dimension
    tilt = snapshot.tilt[: d * (d - 1) // 2] if any(snapshot.tilt) else ()
    low_c, high_c = snapshot.low_c[:d], snapshot.high_c[:d]
    box = Box(tuple(low_c.tolist()), tuple(high_c.tolist()), snapshot.periodic[:d], tilt)
    value_nc, error_nc = place_nc.value, place_nc.error + 2 * EPS * np.abs(place_nc.value)
    if form == "unwrapped":
        error_nc = error_nc + EPS * np.array(box.edge_c)
    else:
        cell_cc = np.abs(box.cell_cc)
        error_nc = (error_nc + (d + 1) * EPS * np.abs(value_nc)) @ cell_cc + EPS * np.abs(low_c)
        value_nc = low_c + value_nc @ box.cell_cc
    return Rounded(value_nc, error_nc + EPS * np.abs(value_nc))


def number(values_n: FloatArray, form: str) -> Rounded:
    """Return numbers with half a unit of the last digit that a format prints, and the rounding of reading them.

    Raises
    ------
    InputError
        Another format than %e, %f and %g.
    """
    match = FORMAT.fullmatch(form)
    if match is None:
        raise InputError("dump_modify format", "must be one of %e, %f and %g, with digits", form)
    digits, style = int(match[1] or 6), match[2].lower()
    if style == "g":
        digits = max(digits, 1)
    if digits >= EXACT.get(style, np.inf):
        return Rounded(values_n, np.zeros(values_n.shape))
    if style == "f":
        return Rounded(values_n, 0.5 * 10.0**-digits + EPS * np.abs(values_n))
    with np.errstate(divide="ignore"):
        exponent_n = np.floor(np.log10(np.abs(values_n)) + 1e-12)  # of 0, which these formats print for 0 alone: -inf
    last_n = exponent_n - (digits if style == "e" else digits - 1)
    return Rounded(values_n, 0.5 * 10.0**last_n + EPS * np.abs(values_n))


def columns_of(path: Path, names: Sequence[str], dumps: Sequence[DeckDump], setup: RunSetup) -> DumpColumns:
    """Return what columns hold, by the dump of the deck that writes them: the one with the file's name, else the first.

    Raises
    ------
    InputError
        No dump of the deck writes such columns.
    """
    described = [_described(dump, setup) for dump in dumps if dump.words[2] == "custom"]
    fitting = [columns for columns in described if list(columns.names) == list(names)]
    if not fitting:
        written = "; ".join(" ".join(columns.names) for columns in described) or "none (dump custom)"
        rule = f"must be those that a dump of the deck writes: {written}"
        raise InputError("columns", rule, " ".join(names), path.name)
    named = (columns for columns in fitting if fnmatch.fnmatch(path.name, _pattern(columns.dump.words[4])))
    return next(named, fitting[0])


def _pattern(file: str) -> str:
    return Path(file).name.replace("[", "[[]").replace("?", "[?]").replace("%", "*")


def _described(dump: DeckDump, setup: RunSetup) -> DumpColumns:
    words = [word for given in dump.words[5:] for word in _expanded(given, setup)]
    names = list(words)
    formats = ["" if word in ("id", "type", "mol", "proc") else DEFAULT for word in words]
    modify = iter(dump.modify)
    for keyword in modify:
        if keyword == "colname":
            if (column := next(modify, "")) != "default":
                names[_place(column, words)] = next(modify, "")
        elif keyword == "format":
            _format(next(modify, ""), modify, formats)
    return DumpColumns(dump, tuple(names), tuple(_part(word, setup) for word in words), tuple(formats))


def _place(column: str, words: Sequence[str]) -> int:
    at = int(column) - 1 if column.lstrip("-").isdigit() else words.index(column) if column in words else len(words)
    if not -len(words) - 1 <= at < len(words):
        raise InputError("dump_modify", "must name a column of the dump", column)
    return at + 1 if at < -1 else at


def _format(which: str, rest: Iterator[str], formats: list[str]) -> None:
    if which == "line":
        formats[:] = next(rest, "").split()
    elif which == "float":
        form = next(rest, "")
        formats[:] = [form if old else old for old in formats]
    elif which == "none":
        formats[:] = [DEFAULT if old else old for old in formats]
    elif which == "int":
        next(rest, "")
    else:
        formats[_place(which, formats)] = next(rest, "")


def _expanded(word: str, setup: RunSetup) -> list[str]:
    """Return the columns that a word with a wild card stands for; other words as they are."""
    match = re.fullmatch(r"(c_(\w+))\[([0-9]*)\*([0-9]*)\]", word)
    if match is None or match[2] not in setup.computes:
        return [word]
    last = len(_attributes(setup.computes[match[2]], setup.dimension))
    return [f"{match[1]}[{k}]" for k in range(int(match[3] or 1), int(match[4] or last) + 1)]


def _part(word: str, setup: RunSetup) -> Component | None:
    """Return what a column holds; None if it does not matter."""
    if word == "mass":
        return Component("mass", 0)
    if len(word) <= 2 and word[:-1] in ("", "v", "f") and word[-1] in "xyz":
        return Component(word[:-1] or "x", "xyz".index(word[-1]))
    if re.fullmatch("[xyz][su]", word):
        return Component("unwrapped" if word[1:] == "u" else "scaled", "xyz".index(word[0]))
    match = re.fullmatch(r"c_(\w+)(?:\[([0-9]+)\])?", word)
    if match is None or match[1] not in setup.computes:
        return None
    attributes = _attributes(setup.computes[match[1]], setup.dimension)
    at = int(match[2] or 1) - 1
    return attributes[at] if at < len(attributes) else None


def _attributes(words: Sequence[str], dimension: int) -> list[Component | None]:
    """Return what the columns of a compute hold."""
    if words[3] == "property/atom":
        return [Component(OF_ATOM[word], 0) if word in OF_ATOM else None for word in words[4:]]
    if words[3] != "rheo/property/atom":
        return []
    return [part for word in words[4:] for part in _components(word, dimension)]


def _components(attribute: str, dimension: int) -> list[Component | None]:
    columns = {field.column: field.name for field in FIELDS.values() if field.column and not field.of_solids}
    stem, _, component = attribute.rpartition("/")
    if attribute in columns:
        return [Component(columns[attribute], 0)]
    if stem not in columns:
        return [None]
    rank, axes = QUANTITIES[stem].rank, "xyz"[:dimension]
    if component == "*":
        return [Component(stem, k) for k in range(dimension**rank)]
    order: Mapping[str, int] = {"".join(pair): k for k, pair in enumerate(itertools.product(axes, repeat=rank))}
    return [Component(stem, order[component]) if component in order else None]


def whole(dump: DeckDump) -> str:
    """Return why a dump may hold only some of the particles; or nothing."""
    if dump.words[1] != "all":
        return f"the dump holds group {dump.words[1]} alone"
    some = next((word for word in ("thresh", "region") if word in dump.modify), "")
    return f"the dump holds some particles alone (dump_modify {some})" if some else ""


def by_columns(name: str, held: Container[str]) -> bool:
    """Return whether a field follows from other columns of the same particle."""
    return name == "pressure" or (name in OF_GRADIENT and "grad/v" in held)


class _Printed(ArrayEvaluator):
    """Pairs of positions of limited precision: all that may be within the cutoff; beyond it their kernel is 0."""

    spread = 0.0

    def pairs(self, x_nc: FloatArray, cut: float) -> Any:
        """Return the directed pairs that may be closer than a cutoff."""
        return directed_pairs(x_nc, self.box, cut + self.spread)


@dataclass(frozen=True)
class FrameSample(ParticleSample):
    """A snapshot.

    Attributes
    ----------
    of_forces : the state that the forces saw, with the errors of the printed digits
    at_end : densities and energies of the dump, as far as it has them
    gradient_ncc : its velocity gradients, if it has them
    """

    of_forces: State | None = None
    at_end: Mapping[str, Rounded] = field(default_factory=dict)
    gradient_ncc: Rounded | None = None

    def rounded(self) -> State:
        """Return the state that the forces saw."""
        assert self.of_forces is not None
        return replace(self.of_forces)


class FrameEvaluation(SampleEvaluation):
    """What follows from a snapshot."""

    sample: FrameSample

    def __init__(
        self, sample: FrameSample, fields: Sequence[str], stages: type[ArrayEvaluator] = ArrayEvaluator
    ) -> None:
        held = () if sample.gradient_ncc is None else ("grad/v",)
        self.by_columns = {name for name in fields if by_columns(name, held)}
        of_state = [name for name in fields if name not in self.by_columns]
        spread = 2 * float(np.sqrt(sample.model.dimension) * error(sample.rounded().x_nc).max(initial=0.0))
        printed = type("Printed", (_Printed,), {"spread": spread, "by_rows": False})
        together = printed if stages is ArrayEvaluator else type("Printed", (printed, stages), {})
        super().__init__(sample, of_state, together if spread else stages)
        now = self.simulation.state
        now.rho_n, now.energy_n = (sample.at_end.get(name, old) for name, old in
                                   (("rho", now.rho_n), ("energy", now.energy_n)))  # fmt: skip
        if sample.gradient_ncc is not None:
            self.simulation.gradient = Gradients(v_ncc=sample.gradient_ncc)
            self.simulation.fields["viscosity"] = self.stages.viscosity(sample.gradient_ncc)

    def comparable(self, field: str) -> Any:
        """Return the particles for which a field can be compared, (n,): those that the digits decide."""
        n = len(self.sample.state.solid_n)
        may_n = np.ones(n, bool) if field in self.by_columns else super().comparable(field)
        return may_n & np.isfinite(error(self.output(field)).reshape(n, -1)).all(axis=1) if may_n.any() else may_n


def lacking(name: str, model: Model, held: Container[str], set_up: bool, whole: str) -> str:
    """Return what is missing to check a field of a snapshot that holds some quantities; nothing if it can be."""
    wanted = ["rho"] if name in ("pressure", "stress/t") else []
    wanted += ["energy", "mass"] if wanted and model.eos.needs_energy else []
    if not by_columns(name, held) and needs(name, "pairs", model):
        if whole:
            return f"{whole}, and sums need the neighbours"
        wanted += ["x", *_of_forces(name, model, set_up)]
    if name == "temperature":
        wanted += ["energy", *([] if set_up else ["heatflow"])]
    missing = [NAMED.get(each, each) for each in dict.fromkeys(wanted) if each not in held]
    if not missing:
        return ""
    moved = not set_up and {*_of_forces(name, model, False)} != {*_of_forces(name, model, True)}
    back = ", as the forces saw the state half a step before the dump" if moved else ""
    return f"the dump lacks {', '.join(missing)}{back}"


def _of_forces(name: str, model: Model, set_up: bool) -> list[str]:
    """Return the sources of the densities, velocities and energies that a field's sums take."""
    quantities = dependencies(model, name)
    wanted = ["mass"]
    if "rho" in quantities and name != "rho":
        wanted += ["rho"]
        if not (set_up or model.fix.rho_sum):
            wanted += ["grad/v", *(["drho"] if model.pair.rho_damp else [])]
    if "v" in quantities:
        wanted += ["v", *([] if set_up else ["f"])]
    if "temperature" in quantities or ("f" in quantities and model.eos.needs_energy):
        wanted += ["energy", *([] if set_up else ["heatflow"])]
    return wanted


def state_of_forces(
    held: Mapping[str, Rounded], model: Model, type_n: Any, solid_n: Any, dt: float, set_up: bool
) -> State:
    r"""Return the state that the forces saw; parts that do not follow from what is held are 0.

    :math:`\mathbf v-\frac{\Delta t}2\mathbf f/m`, of fluid :math:`\rho` from
    :math:`\rho+\frac{\Delta t}2(D-\rho\nabla\cdot\mathbf v)` with the diffusion D, and the energy less half a step
    of the heat flow.
    """
    n, d, half = len(type_n), model.dimension, 0.0 if set_up else 0.5 * dt
    none_n = Rounded(np.zeros(n))
    v_nc, rho_n = held.get("v", Rounded(np.zeros((n, d)))), held.get("rho", none_n)
    energy_n = held.get("energy", none_n) if model.thermal is not None else None
    if half and "f" in held and "mass" in held:
        v_nc = v_nc - half * (held["f"] / held["mass"][:, None])
    if half and not model.fix.rho_sum and "grad/v" in held:
        gradient_ncc = held["grad/v"]
        trace_n = gradient_ncc[:, 0, 0]
        for a in range(1, d):
            trace_n = trace_n + gradient_ncc[:, a, a]
        diffusion_n = held.get("drho", none_n) if model.pair.rho_damp else none_n
        rho_n = where(solid_n, rho_n, (rho_n - half * diffusion_n) / (1.0 - half * trace_n))
    if half and energy_n is not None and "heatflow" in held:
        energy_n = energy_n - half * held["heatflow"]
    return State(held.get("x", Rounded(np.zeros((n, d)))), v_nc, rho_n, type_n, solid_n, energy_n)


def plain(state: State) -> State:
    """Return a state without errors."""
    energy_n = None if state.energy_n is None else value(state.energy_n)
    return State(value(state.x_nc), value(state.v_nc), value(state.rho_n), state.type_n, state.solid_n, energy_n)
