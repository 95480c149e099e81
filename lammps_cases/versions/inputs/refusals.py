"""Bad input that the reference refuses in one line: decks as it reads them, and hand-written inputs.

The latter (``probes/inputs.yaml``) are mistakes that no single command shows: particles, boxes, runs, forces, and
contradictions within a scene. The words of the commands are generated (`lammps_cases.versions.inputs.generate`).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eos_ref import InputError, parse_fix_rheo, parse_fix_rheo_pressure, resolve
from eos_ref.model import quantities
from eos_ref.model.box import Box
from eos_ref.model.commands import parse_fix_rheo_thermal, parse_fix_rheo_viscosity, parse_pair_style_rheo
from eos_ref.model.parameters import Model, PairRheo, Viscosity
from eos_ref.model.state import State, check_state
from eos_ref.syntax.ranges import type_range
from eos_ref.syntax.words import Words, split
from lammps_cases.claims.probes.probe import Commands, Input, Probe, base, commands, load, load_scene, offending
from lammps_cases.scene.fields import FIELDS

# Other commands of the decks, always the same.
OTHERS = (
    *("units", "dimension", "comm_modify", "neighbor", "lattice", "region", "create_atoms", "variable", "timestep"),
    *("displace_atoms", "velocity", "group"),
)
ATOM_STYLES = ("rheo", "rheo/thermal")


class BadInput(Probe):
    """An input that the project refuses, its id the name of the refusal in words joined by hyphens.

    Attributes
    ----------
    area : subject of the input
    names : the manual's words for the wrong quantity; a clear error contains one of them, or the offending word
    promise : the statement of LAMMPS' manual about it, if any
    scene : keys of the equivalent scene; without them, and without a check, the edited fixes are parsed
    """

    base: str = "one"
    area: str
    names: tuple[str, ...]
    promise: str = ""
    scene: dict[str, Any] | None = None

    @property
    def refusal(self) -> str:
        """Error message of this project."""
        return scene_refusal(self, self.scene)

    @property
    def words(self) -> str:
        """Commands in which it differs from its base, as a deck would hold them."""
        before = set(commands(base(self.base)))
        lines = [line for line in commands(self.input) if line not in before]
        return "; ".join(lines) or f"without {', '.join(self.drop)}"

    @property
    def clear(self) -> tuple[str, ...]:
        """Words of which a clear error contains one."""
        return (*self.names, *offending(self))

    @property
    def others(self) -> tuple[str, ...]:
        """Words by which an error names something else; unknown for a scene."""
        return ()

    @property
    def control(self) -> Input:
        """The same without the mistake."""
        return base(self.base)


@functools.cache
def bad_inputs() -> tuple[BadInput, ...]:
    """Return all inputs, in the order of the list."""
    return load("inputs.yaml", BadInput)


def refusal(commands: Commands) -> str:
    """Return the rule by which the reference refuses a deck, without the place; empty if it accepts it."""
    try:
        deck = InputState()
        for line in commands:
            deck.read(line)
    except InputError as error:
        return str(InputError(error.what, error.rule, error.found))
    return ""


@dataclass
class InputState:
    """State after the commands read so far."""

    ntypes: int = 0
    atom_style: str = ""
    mass_t: dict[int, float] = field(default_factory=dict)
    fixes: dict[str, str] = field(default_factory=dict)  # by style
    names: dict[str, str] = field(default_factory=dict)  # styles by ID
    pair: str = ""
    coefficients: bool = False
    computes: list[str] = field(default_factory=list)
    particle: dict[str, float] = field(default_factory=dict)

    def read(self, line: str) -> None:
        """Read a command.

        Raises
        ------
        InputError
            It breaks a rule of the manual, or has no meaning.
        """
        words = split(line)
        command = words.choice("command", (*_READERS, "fix", "compute", "run", *OTHERS))
        if command == "fix":
            self._fix(line)
        elif command == "compute":
            if line.split()[1:2] in [other.split()[1:2] for other in self.computes]:
                words.fail("compute ID", "must not be that of another compute", line.split()[1])
            self.computes.append(line)
        elif command == "run":
            self._run()
        elif command in _READERS:
            _READERS[command](self, words)

    def _fix(self, line: str) -> None:
        words = split(line)
        style = words.words[3] if len(words.words) > 3 else ""
        if style == "enforce2d":
            return
        name = words.words[1] if len(words.words) > 1 else ""
        if style not in _FIXES:
            words.fail("fix style", "must be one of " + ", ".join(_FIXES), style)
        if not self.ntypes:
            words.fail(f"fix {style}", "must follow create_box")
        if self.names.get(name, style) != style:
            words.fail("fix ID", f"must not be that of fix {self.names[name]}", name)
        if style in self.names.values() and name not in self.names:  # a fix of the same ID is replaced
            words.fail(f"fix {style}", "must be the only one of its style")
        if style != "rheo" and "rheo" not in self.fixes:
            words.fail(f"fix {style}", "must follow fix rheo")
        _FIXES[style](line, self.ntypes)
        self.fixes[style], self.names[name] = line, style

    def _run(self) -> None:
        model = self.model()
        for line in self.computes:
            attributes(split(line), model)
        for name, needed in (("rho", not model.fix.rho_sum), ("energy", model.thermal is not None)):
            if needed and name not in self.particle:
                raise InputError({"rho": "density"}.get(name, name), "must be given for every particle")
        one = {"rho": 1.0, "energy": 1.0, "status": 0.0} | self.particle
        for t in range(1, self.ntypes + 1):
            energy_n = np.array([one["energy"]]) if model.thermal else None
            rho_n, solid_n = np.array([one["rho"]]), np.array([one["status"] == 1])
            state = State(np.ones((1, 2)), np.zeros((1, 2)), rho_n, np.array([t]), solid_n, energy_n)
            check_state(model, Box((0.0, 0.0), (9.0, 8.0), (True, True)), state)

    def model(self) -> Model:
        """Return the model of all commands.

        Raises
        ------
        InputError
            A command is missing, or they contradict each other.
        """
        for style in ("rheo", "rheo/viscosity", "rheo/pressure"):
            if style not in self.fixes:
                raise InputError("deck", f"needs fix {style}")
        for t in range(1, self.ntypes + 1):
            if t not in self.mass_t:
                raise InputError("mass", f"must be given for atom type {t}")
        if not self.pair or not self.coefficients:
            raise InputError("deck", f"needs {'pair_coeff' if self.pair else 'pair_style'}")
        fix = parse_fix_rheo(self.fixes["rheo"], self.ntypes)
        if fix.thermal and self.atom_style != "rheo/thermal":
            raise InputError("thermal", "needs atom style rheo/thermal", self.atom_style)
        heated = self.fixes.get("rheo/thermal")
        return Model(
            2,
            fix,
            tuple(self.mass_t[t] for t in range(1, self.ntypes + 1)),
            resolve(parse_fix_rheo_pressure(self.fixes["rheo/pressure"]), self.ntypes, fix.rho0, fix.cs),
            parse_pair_style_rheo(self.pair),
            parse_fix_rheo_viscosity(self.fixes["rheo/viscosity"], self.ntypes),
            parse_fix_rheo_thermal(heated, self.ntypes) if heated else None,
        )


_FIXES: Mapping[str, Callable[[str, int], object]] = {
    "rheo": parse_fix_rheo,
    "rheo/pressure": lambda line, ntypes: resolve(parse_fix_rheo_pressure(line), ntypes),
    "rheo/viscosity": parse_fix_rheo_viscosity,
    "rheo/thermal": parse_fix_rheo_thermal,
}


def _atom_style(deck: InputState, words: Words) -> None:
    deck.atom_style = words.choice("atom style", ATOM_STYLES)
    words.end("atom_style")


def _create_box(deck: InputState, words: Words) -> None:
    deck.ntypes = words.integer("number of atom types")
    if not deck.atom_style:
        words.fail("atom_style", "must precede the box")


def _mass(deck: InputState, words: Words) -> None:
    if not deck.ntypes:
        words.fail("mass", "must follow create_box")
    types = type_range(words.word("types of mass"), deck.ntypes, words.command)
    value = words.number("mass")
    words.end("mass")
    if value <= 0:
        words.fail("mass", "must be positive", value)
    deck.mass_t |= dict.fromkeys(types, value)


def _pair_style(deck: InputState, words: Words) -> None:
    parse_pair_style_rheo(words.command)
    deck.pair, deck.coefficients = words.command, False


def _pair_coeff(deck: InputState, words: Words) -> None:
    if not deck.pair:
        words.fail("pair_coeff", "must follow pair_style")
    for which in ("first", "second"):
        types = type_range(words.word(f"{which} types of pair_coeff"), deck.ntypes, words.command)
        if len(types) != deck.ntypes:
            words.fail("types of pair_coeff", "must be all, with which pair_style rheo has no coefficients")
    words.end("pair_coeff")
    deck.coefficients = True


_ATTRIBUTES = {"rheo/rho": "rho", "rheo/status": "status", "sph/e": "energy"}


def _set(deck: InputState, words: Words) -> None:
    style = words.choice("set style", ("group", "type"))
    which = words.word("particles of set")
    if style == "type":
        type_range(which, deck.ntypes, words.command)
    attribute = words.choice("attribute of set", (*_ATTRIBUTES, "type"))
    if words.peek() in ("v_type", "v_rho", "v_e"):  # of the deck
        words.word("variable")
        deck.particle[_ATTRIBUTES.get(attribute, attribute)] = 1.0
    elif attribute == "rheo/status":
        status = words.integer("rheo/status")
        if status not in (0, 1):
            words.fail("rheo/status", "must be 0 (fluid) or 1 (solid)", status)
        deck.particle["status"] = float(status)
    else:
        deck.particle[_ATTRIBUTES.get(attribute, attribute)] = words.number(attribute)
    if attribute == "sph/e" and deck.atom_style != "rheo/thermal":
        words.fail("sph/e", "needs atom style rheo/thermal")
    words.end("set")


_READERS: dict[str, Callable[[InputState, Words], Any]] = {
    "atom_style": _atom_style,
    "create_box": _create_box,
    "mass": _mass,
    "pair_style": _pair_style,
    "pair_coeff": _pair_coeff,
    "set": _set,
}


def attributes(words: Words, model: Model) -> tuple[str, ...]:
    """Read the attributes of compute rheo/property/atom.

    Raises
    ------
    InputError
        No attribute, an unknown one, one that the model lacks, or components that do not exist.
    """
    for what, word in (("command", "compute"), ("compute ID", ""), ("group-ID", ""), ("style", "rheo/property/atom")):
        token = words.word(what)
        if word and token != word:
            words.fail(what, f"must be {word}", token)
    names: list[str] = []
    while words.left or not names:
        names.append(_attribute(words, words.word("attribute"), model))
    return tuple(names)


def _attribute(words: Words, attribute: str, model: Model) -> str:
    columns = [field.column for field in FIELDS.values() if field.column]
    stem, _, components = attribute.rpartition("/")
    if attribute == "nbond/shell":
        words.fail(attribute, "needs fix rheo/oxidation")
    name = attribute if attribute in columns else stem
    if name not in columns:
        words.fail("attribute", "must be one of compute rheo/property/atom", attribute)
    rank = quantities.of_model(model, name).rank
    axes = "xyz"[: model.dimension]
    if name == attribute:
        if rank:
            words.fail(attribute, f"needs components: {attribute}/*")
    elif not rank or (components != "*" and (len(components) != rank or set(components) - set(axes))):
        words.fail(f"components of {name}", f"must be {rank} of {', '.join(axes)}, or *", components)
    return attribute


def scene_refusal(bad: Probe, scene: Mapping[str, Any] | None) -> str:
    """Return the rule that refuses an input, and its value, without the place; empty if none does.

    Parameters
    ----------
    scene : mapping, optional
        Keys of the equivalent scene; without them, and without a check, the fixes are parsed.
    """
    try:
        if scene is not None:
            load_scene(bad.base, scene)
        elif bad.id in CHECKS:
            CHECKS[bad.id]()
        else:
            parse(bad)
    except InputError as error:
        return str(InputError(error.what, error.rule, error.found))
    return ""


def parse(bad: Probe) -> None:
    """Read the fixes of an input as the reference does.

    Raises
    ------
    InputError
    """
    lines = {" ".join(line.split()[:2]): line for line in commands(bad.input)}
    ntypes = sum(name.startswith("mass") for name in lines)
    fix = parse_fix_rheo(lines["fix rheo"], ntypes)
    resolve(parse_fix_rheo_pressure(lines["fix pressure"]), ntypes, fix.rho0, fix.cs)


def _model(types: int = 1, viscosities: int | None = None, thermal: bool = False) -> Model:
    fix = parse_fix_rheo("fix rheo all rheo 3.0 quintic 0" + " thermal" * thermal)
    law = resolve(parse_fix_rheo_pressure("fix pressure all rheo/pressure * linear"), types)
    viscosity = Viscosity("constant", 0.1)
    return Model(2, fix, (1.2,) * types, law, PairRheo(3.0), (viscosity,) * (viscosities or types))


def _state(**first: tuple[float, float]) -> None:
    """Check two particles of which the first has other values."""
    state = State(np.array([[1.0, 1.0], [3.0, 3.0]]), np.zeros((2, 2)), np.ones(2), np.ones(2, int), np.zeros(2, bool))
    for name, value in first.items():
        getattr(state, name)[0] = value
    check_state(_model(), Box((0.0, 0.0), (8.0, 8.0), (False, True)), state)


CHECKS: dict[str, Callable[[], object]] = {
    "thermal-without-fix-thermal": lambda: _model(thermal=True),
    "viscosity-of-unknown-style": lambda: Viscosity("newtonian", 0.1),  # type: ignore[arg-type]
    "viscosity-of-one-type-of-two": lambda: _model(types=2, viscosities=1),
    "artificial-viscosity-nan": lambda: PairRheo(3.0, math.nan),
    "rho-damp-infinite": lambda: PairRheo(3.0, 0.0, math.inf),
    "position-nan": lambda: _state(x_nc=(math.nan, 1.0)),
    "outside-of-an-open-box": lambda: _state(x_nc=(-5.0, 1.0)),
    "particles-on-one-spot": lambda: _state(x_nc=(3.0, 3.0)),
    "velocity-nan": lambda: _state(v_nc=(math.nan, 0.0)),
    "region-inside-out": lambda: Box((8.0, 0.0), (0.0, 8.0), (True, True)),
    "box-infinite": lambda: Box((0.0, 0.0), (math.inf, 8.0), (True, True)),
}
