"""Commands of a deck in another unit of length; the units of mass and time stay.

A command is a form: the dimensions of its first words, and of the words behind each of its keywords. A command that has
no form here, or with a number that is not a plain number, is refused: the new deck must mean the same.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

from eos_ref.eos.registry import LAWS
from eos_ref.errors import InputError
from eos_ref.syntax.manual import Manual, weighs_distance
from lammps_cases.audit.messages import ScriptCommand
from lammps_cases.setup.twins import Scale

RULE = "cannot be rescaled with certainty"
TYPES = "types"  # one word or more
EACH = " of every type"  # after a dimension: all following numbers
_TYPES = re.compile(r"\d*\*?\d*")
Dims = tuple[str | None, ...]  # None for a word that stays


@dataclass(frozen=True)
class WordForm:
    """The dimensions of a command's words: of the first ones, then by keyword; None for keywords: the rest stays."""

    head: Dims = ()
    keywords: dict[str, Dims] | None = field(default_factory=dict)
    by_type: bool = False  # whether types may replace a keyword


STAYS = WordForm((), None)
NUMBER: Dims = (None,)
FORCES: Dims = ("f", "f", "f")
FIXES = {
    "rheo": WordForm(
        ("x", None, None),
        {
            **dict.fromkeys(("thermal", "interface/reconstruct", "rho/sum", "self/mass", "shift"), ()),
            "surface/detection": (None, None, None),
            "exclude/type": (TYPES,),
            "scale/cross/type": (None, None, "support"),
            "density": ("rho" + EACH,),
            "speed/sound": ("v" + EACH,),
        },
    ),
    # K, a viscosity times a rate to some power, has the factor of a viscosity as long as the unit of time stays.
    "rheo/viscosity": WordForm((), {"constant": ("viscosity",), "power": ("viscosity", None, "viscosity", None)}, True),
    "rheo/pressure": WordForm(
        (),
        {
            **{
                style: (None if law.parameter == "gamma" else law.parameter,) * bool(law.parameter)
                for style, law in LAWS.items()
            },
            "background": ("pressure",),
        },
        True,
    ),
    "rheo/thermal": WordForm(
        (),
        {
            "conductivity": (TYPES, None, "conductivity"),
            "specific/heat": (TYPES, None, "cv"),
            "latent/heat": (TYPES, None, "latent heat"),
            "Tfreeze": (TYPES, None, None),
        },
    ),
    "gravity": WordForm(("acceleration",), {"vector": (None, None, None)}),
    "addforce": WordForm(FORCES),
    "setforce": WordForm(FORCES),
    "add/heat": WordForm((), {"constant": ("heatflow",), "linear": (None, "heatflow"), "overwrite": NUMBER}),
    "enforce2d": WordForm(),
    **dict.fromkeys(("momentum", "print", "vector", "store/state", "store/force", "ave/time", "ave/atom"), STAYS),
}
_ORDER = {
    **dict.fromkeys(("units", "dimension", "boundary", "box", "newton", "processors", "comm_style", "suffix"), STAYS),
    "atom_modify": WordForm((), {"map": NUMBER, "first": NUMBER, "id": NUMBER, "sort": (None, "x")}),
}
BEFORE_BOX = (*_ORDER, "atom_style")
COMMANDS = {
    **_ORDER,
    **dict.fromkeys(("unfix", "uncompute", "undump", "timestep", "reset_timestep", "pair_coeff"), STAYS),
    **dict.fromkeys(("thermo", "thermo_style", "thermo_modify", "log", "dump", "write_dump", "write_data"), STAYS),
    **dict.fromkeys(("restart", "write_restart"), STAYS),
    "pair_style": WordForm(
        (None, "x"), {"artificial/visc": NUMBER, "harmonic/means": (), "rho/damp": ("diffusivity",)}
    ),
    "neighbor": WordForm(("x", None)),
    "neigh_modify": WordForm((), dict.fromkeys(("every", "delay", "check", "once", "page", "one", "cluster"), NUMBER)),
    "comm_modify": WordForm((), {"mode": NUMBER, "vel": NUMBER, "cutoff": ("x",)}),
    "fix_modify": WordForm(NUMBER, dict.fromkeys(("energy", "virial", "press"), NUMBER)),
}
# Computes without a length, or another number with a dimension, among their words.
COMPUTES = (
    *("rheo/property/atom", "property/atom", "ke", "ke/atom", "pe", "pe/atom", "temp", "pressure", "stress/atom"),
    *("reduce", "com", "vcm", "count/type"),
)

# Commands that made the particles of the data file; refused after the first run, where they would change them.
MAKERS = frozenset(
    {
        *("lattice", "region", "create_box", "create_atoms", "read_data", "read_dump", "molecule"),
        *("mass", "set", "group", "delete_atoms", "displace_atoms", "velocity", "change_box", "replicate"),
        *("reset_atoms",),
    }
)
FLOW = frozenset({"label", "jump", "include", "next", "quit"})  # whose effects the followed deck already has
PRINTED = frozenset({"print", "echo", "info", "timer"})
_NAMES = re.compile(r"v_(\w+)|\$\{(\w+)\}|\$(\w)")


@dataclass(frozen=True)
class Scaling:
    """The factors of a deck's numbers, by a version of the manual."""

    scale: Scale
    manual: Manual

    def factor(self, dimension: str) -> float:
        """Return the factor of a number."""
        if dimension == "support":  # of scale/cross/type: one over volume, or length over volume
            return self.scale.of("kernel") * (self.scale.of("x") if weighs_distance(self.manual) else 1.0)
        return self.scale.of(dimension)

    def command(self, command: ScriptCommand) -> list[str]:
        """Return the words of a command with its numbers scaled.

        Raises
        ------
        InputError
            It cannot be scaled with certainty.
        """
        values = command.values
        try:
            return self.words(values)
        except ValueError as error:
            what = f"{values[0]} {values[3]}" if values[0] in ("fix", "compute") and len(values) > 3 else values[0]
            rule = f"{RULE} ({error})" if str(error) else RULE
            raise InputError(f"command {what}", rule, " ".join(values), command.where) from None

    def words(self, values: Sequence[str]) -> list[str]:
        """Return the words of a command with its numbers scaled.

        Raises
        ------
        ValueError
            The word that cannot be scaled; without text if the whole command cannot.
        """
        match values:
            case ["fix", _, _, style, *_] if style in FIXES:
                return self._walked(values, 4, FIXES[style])
            case ["compute", _, _, style, *_] if style in COMPUTES:
                return list(values)
            case ["dump_modify", *words] if not {"thresh", "region"} & set(words):
                return list(values)
            case ["neigh_modify", "exclude", "type" | "group", _, _]:
                return list(values)
            case ["run", *words] if "every" not in words:
                return list(values)
            case ["atom_style", "rheo" | "rheo/thermal"]:
                return list(values)
            case ["pair_style", style, *_] if style != "rheo":
                raise ValueError(style)
            case [name, *_] if name in COMMANDS:
                return self._walked(values, 1, COMMANDS[name])
        raise ValueError

    def _walked(self, values: Sequence[str], at: int, form: WordForm) -> list[str]:
        waiting, made = list(values[at:]), list(values[:at])
        made += self._taken(waiting, form.head)
        if form.keywords is None:
            return made + waiting
        while waiting:
            word = waiting.pop(0)
            made.append(word)
            if form.by_type and _TYPES.fullmatch(word):
                continue
            if word not in form.keywords:
                raise ValueError(word)
            made += self._taken(waiting, form.keywords[word])
        return made

    def _taken(self, waiting: list[str], dims: Dims) -> list[str]:
        """Take words from the waiting ones by their dimensions, and scale them."""
        made: list[str] = []
        for dimension in dims:
            if dimension == TYPES:
                while waiting and _TYPES.fullmatch(waiting[0]):
                    made.append(waiting.pop(0))
            elif dimension is not None and dimension.endswith(EACH):
                while waiting and not waiting[0][:1].isalpha():
                    made.append(self._number(waiting.pop(0), dimension.removesuffix(EACH)))
            elif waiting:
                made.append(self._number(waiting.pop(0), dimension))
        return made

    def _number(self, word: str, dimension: str | None) -> str:
        if dimension is None or word == "NULL":
            return word
        try:
            number = float(word)
        except ValueError:
            raise ValueError(word) from None
        return word if number == 0 else repr(number * self.factor(dimension))


def kept_commands(script: Sequence[ScriptCommand]) -> Iterator[ScriptCommand]:
    """Yield the commands that the new deck needs.

    Raises
    ------
    InputError
        A command after the first run that depends on the run's result, or that changes particles.
    """
    for command in script:
        name = (command.values or command.written.split())[0]
        making = name in MAKERS and "dynamic" not in command.values
        if name in PRINTED or name in FLOW or (not command.runs and (making or not command.values)):
            continue
        refuse = partial(InputError, f"command {name}", found=command.written, where=command.where)
        if command.runs and (making or name in BEFORE_BOX or not command.values):
            raise refuse(rule=f"{RULE} after the first run")
        if command.runs and "$" in command.written:
            raise refuse(rule=f"{RULE}, as it depends on a variable after the first run")
        yield command


def needed_variables(kept: Sequence[ScriptCommand]) -> set[str]:
    """Return the names of variables that commands, or these variables, refer to."""
    named = {command.values[1]: _names(command.values[2:]) for command in kept if command.values[0] == "variable"}
    needed: set[str] = set()
    waiting = [name for command in kept if command.values[0] != "variable" for name in _names(command.values)]
    while waiting:
        name = waiting.pop()
        if name not in needed:
            needed.add(name)
            waiting += named.get(name, ())
    return needed


def _names(words: Sequence[str]) -> list[str]:
    return [next(filter(None, found)) for found in _NAMES.findall(" ".join(words))]
