"""The particle model by a deck's commands: its parameters, the forces of other fixes, what excludes a check.

Commands come as LAMMPS got them, substituted. LAMMPS has accepted them, so nothing is judged here; what cannot be
followed (a keyword of a later version, a variable where a number is expected) is reported, and leaves fields unchecked.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from eos_ref import EOSTable, parse_fix_rheo, parse_fix_rheo_pressure, resolve
from eos_ref.errors import InputError
from eos_ref.model import commands, elastic_commands
from eos_ref.model.bonds import Elastic
from eos_ref.model.parameters import Model, PairRheo
from eos_ref.syntax.manual import FIRST, Manual
from eos_ref.syntax.words import Words

# Commands that a run may execute in between (run ... every) without changing the model.
HARMLESS = frozenset(
    {"print", "variable", "info", "log", "write_data", "write_dump", "write_restart", "thermo", "NULL"}
)
# Those after which a run needs no set-up ('pre no'), as LAMMPS reads what they change at every step.
UNPREPARED = HARMLESS | {
    *("dump", "dump_modify", "undump", "thermo_style", "thermo_modify", "restart", "timer", "echo", "shell", "python"),
    *("compute", "uncompute", "group", "region", "lattice", "velocity", "set", "displace_atoms", "timestep"),
}


@dataclass(frozen=True)
class Action:
    """A fix that changes forces: gravity (acceleration), addforce, setforce (None leaves a component)."""

    style: str
    group: str
    vector: tuple[float | None, ...]


@dataclass
class Deck:
    """Records commands; `model` and the other methods interpret them."""

    fixes: dict[str, list[str]] = field(default_factory=dict)  # in the order in which LAMMPS calls them
    pair: list[str] = field(default_factory=list)
    coefficients: list[list[str]] = field(default_factory=list)
    special: list[str] = field(default_factory=list)
    bonded: list[str] = field(default_factory=list)
    bonds: list[str] = field(default_factory=list)  # the words of bond_style
    bond_coefficients: list[list[str]] = field(default_factory=list)
    excludes: bool = False

    def note(self, values: list[str]) -> None:
        """Record a command that LAMMPS has executed."""
        match values:
            case ["fix", name, _, _, *_]:
                # LAMMPS reads a range with a hyphen as its first number, which is a finding.
                self.fixes[name] = [word.partition("-")[0] if word in hyphens(values) else word for word in values]
            case ["unfix", name]:
                self.fixes.pop(name, None)
            case ["pair_style", *arguments]:
                self.pair, self.coefficients = arguments, []
            case ["pair_coeff", *arguments]:
                self.coefficients.append(arguments)
            case ["special_bonds", *arguments]:
                self.special = arguments
            case [
                ("bond_style" | "angle_style" | "dihedral_style" | "improper_style" | "kspace_style") as kind,
                style,
                *_,
            ]:
                if kind == "bond_style":
                    self.bonds, self.bond_coefficients = values[1:], []
                self.bonded = [k for k in self.bonded if not k.startswith(kind)]
                self.bonded += [] if style == "none" else [f"{kind} {style}"]
            case ["bond_coeff", *arguments]:
                self.bond_coefficients.append(arguments)
            case ["neigh_modify", *arguments] if "exclude" in arguments:
                self.excludes = arguments[arguments.index("exclude") + 1 :][:1] != ["none"]
            case ["clear"]:
                self.__init__()  # type: ignore[misc]

    def fix(self, style: str) -> list[str] | None:
        """Return the words of the last fix of a style."""
        return next((values for values in reversed(self.fixes.values()) if values[3] == style), None)

    def model(
        self,
        dimension: int,
        ntypes: int,
        mass_t: Sequence[float],
        eos: EOSTable,
        manual: Manual = FIRST,
        bond_types: int = 0,
    ) -> Model:
        """Return the particle model according to a version of the manual; without elastic forces not followed.

        Raises
        ------
        InputError
            Something that cannot be followed, or that contradicts itself.
        """
        rheo, viscous = self.fix("rheo"), self.fix("rheo/viscosity")
        if rheo is None or viscous is None:
            raise InputError("deck", "defines no fix rheo or no fix rheo/viscosity")
        heated = self.fix("rheo/thermal")
        return Model(
            dimension=2 if dimension == 2 else 3,
            fix=parse_fix_rheo(" ".join(rheo), ntypes, manual),
            mass_t=tuple(mass_t),
            eos=eos,
            pair=pair_rheo(self.pair),
            viscosity=commands.parse_fix_rheo_viscosity(" ".join(viscous), ntypes),
            thermal=None if heated is None else commands.parse_fix_rheo_thermal(" ".join(heated), ntypes),
            elastic=self.elastic(ntypes, bond_types) if not self.adds_unfollowed(ntypes, bond_types) else None,
        )

    def elastic(self, ntypes: int, bond_types: int) -> Elastic | None:
        """Return what bonds and contacts of solids obey; None without any.

        Raises
        ------
        InputError
            Something that cannot be followed.
        """
        bonds = elastic_commands.parse_bonds(self.bonds, self.bond_coefficients, bond_types) if self.bonds else ()
        contact = None
        if "rheo/solid" in self.pair:
            weights = _weights(self.special)[0]
            if weights[1:] != [1.0, 1.0]:
                rule = "must weigh second and third neighbours by 1 to be followed with rheo/solid"
                raise InputError("special_bonds", rule, " ".join(self.special))
            coefficients = [[*v[:2], *v[3:]] for v in self.coefficients if v[2:3] == ["rheo/solid"]]
            contact = elastic_commands.parse_contact(coefficients, ntypes, weights[0])
        return Elastic(bonds, contact) if bonds or contact else None

    def laws(self, ntypes: int) -> EOSTable | None:
        """Return the equations of state of fix rheo and fix rheo/pressure; None unless both are defined."""
        pressure, rheo = self.fix("rheo/pressure"), self.fix("rheo")
        if pressure is None or rheo is None:
            return None
        fix, command = parse_fix_rheo(" ".join(rheo), ntypes), " ".join(pressure)
        return resolve(parse_fix_rheo_pressure(command), ntypes, fix.rho0, fix.cs, command)

    def changes_laws(self, values: list[str]) -> bool:
        """Return whether a command would change the equations of state."""
        match values:
            case ["fix", _, _, style, *_]:
                return style in _LAWS
            case ["unfix", name]:
                return name in self.fixes and self.fixes[name][3] in _LAWS
            case _:
                return values[0] == "clear"

    def sums_walls(self) -> bool:
        """Return whether densities of walls are summed, then reconstructed."""
        words = self.fix("rheo") or []
        return "rho/sum" in words and "interface/reconstruct" in words

    # --- reasons why sums over pairs cannot be checked

    def hides_pairs(self) -> str:
        """Return why the neighbours of a particle are not simply all within the cutoff; or nothing."""
        if self.excludes:
            return "neigh_modify exclude takes pairs out"
        if self.pair[:1] not in ([], ["rheo"]) and not self._rheo_for_all():  # each pair of types has a separate cutoff
            return SOME_TYPES
        return ""

    def changes_pairs(self) -> str:
        """Return why the terms of pair_style rheo are not simply those of all pairs; or nothing."""
        return "" if self._rheo_for_all() else SOME_TYPES

    def keeps_masses(self) -> bool:
        """Return whether images of particles with individual masses have these masses, too."""
        own = (values for values in self.fixes.values() if values[3] == "property/atom" and "rmass" in values)
        return all(("ghost", "yes") in itertools.pairwise(values) for values in own)

    @property
    def unlists_bonded(self) -> bool:
        """Whether LAMMPS may leave pairs of bonded particles out of its neighbour lists."""
        return bool(self.bonded) and any(a == b == 0 for a, b in zip(*_weights(self.special), strict=True))

    def _rheo_for_all(self) -> bool:
        """Return whether pair_coeff gives pair_style rheo to the pairs of all types at once."""
        rheo = [words for words in self.coefficients if "rheo" in words[2:3] or self.pair[:1] == ["rheo"]]
        return any(words[:2] == ["*", "*"] for words in rheo)

    def moves_images(self) -> str:
        """Return why velocities beyond a boundary are not those of the particles there; or nothing."""
        for name, values in self.fixes.items():
            if values[3] == "deform" and ("remap", "v") in itertools.pairwise(values):
                return f"fix {name} (deform) gives images other velocities (remap v)"
        return ""

    def adds_heat(self) -> str:
        """Return what else adds to the heat flow; or nothing."""
        return self._other_fix(lambda style: style not in _HEAT)

    def elastic_styles(self) -> list[str]:
        """Return the styles that add to the force of pair_style rheo: of other pairs, and of bonds."""
        others = [word for word in self.pair[1:] if word[:1].isalpha() and word not in _PAIR_WORDS]
        pairs = [f"pair_style {word}" for word in others] if self.pair[:1] != ["rheo"] else []
        return pairs + [bonds for bonds in self.bonded if not bonds.endswith(" zero")]

    def adds_unfollowed(self, ntypes: int, bond_types: int) -> str:
        """Return which pairs or bonds add to the force of pair_style rheo and are not followed; or nothing."""
        followed = (
            "pair_style rheo/solid",
            *(f"bond_style {style}" for style in ("hybrid", "zero", *elastic_commands.STYLES)),
        )
        if others := [style for style in self.elastic_styles() if style not in followed]:
            return f"{others[0]} adds to it"
        try:
            self.elastic(ntypes, bond_types)
        except InputError as error:
            return str(error)
        return ""

    def acts_on_forces(self) -> str:
        """Return which fix changes forces and is not followed; or nothing."""
        if reason := self._other_fix(lambda style: style in _NO_FORCE or style in _FOLLOWED):
            return reason
        try:
            self.actions()
        except InputError as error:
            return str(error)
        return ""

    def moves_on(self) -> str:
        """Return what, apart from fix rheo, may move particles or the box between the forces and a dump; or nothing."""
        rheo = self.fix("rheo")
        if rheo is not None and rheo[2] != "all":
            return f"fix rheo integrates group {rheo[2]} alone"
        return self._other_fix(lambda style: style.startswith(("rheo", "wall/")) or style in _STAY).replace(
            "add to it", "move particles between the forces and the dump"
        )

    def _other_fix(self, harmless: Callable[[str], bool]) -> str:
        """Name a fix that may add to a sum over pairs, unless its style is harmless; or nothing."""
        others = ((name, values[3]) for name, values in self.fixes.items() if not harmless(values[3]))
        return next((f"fix {name} ({style}) may add to it" for name, style in others), "")

    def actions(self) -> list[Action]:
        """Return the fixes that change forces, in LAMMPS' order.

        Raises
        ------
        InputError
            One whose vector is not plain numbers.
        """
        return [action(values) for values in self.fixes.values() if values[3] in _FOLLOWED]

    def plain_actions(self) -> list[Action]:
        """Return those of `actions` whose vectors are plain numbers."""
        actions = []
        for values in self.fixes.values():
            if values[3] in _FOLLOWED:
                with contextlib.suppress(InputError):
                    actions.append(action(values))
        return actions


def between(values: Sequence[str]) -> str:
    """Return a command that a run executes in between and that may change the model; or nothing."""
    words = values[values.index("every") + 2 :] if "every" in values else ()
    return next((word for word in words if word.split()[:1] and word.split()[0] not in HARMLESS), "")


SOME_TYPES = "pair_coeff gives rheo to some types only"
_LAWS = ("rheo", "rheo/pressure")
_HYPHEN = re.compile("([0-9]+)-[0-9]+")  # never a number


def hyphens(values: Sequence[str]) -> list[str]:
    """Return the words of a command of RHEO's fixes that look like ranges of types but are not."""
    of_rheo = values[0] == "fix" and values[3:4] and values[3].startswith("rheo")
    return [word for word in values[4:] if _HYPHEN.fullmatch(word)] if of_rheo else []


_FOLLOWED = ("gravity", "addforce", "setforce")
_PAIR_WORDS = ("rheo", *commands.PAIR_KEYWORDS)
# Fixes that leave forces alone, or do not act between an evaluation and a sample.
_NO_FORCE = (
    *("rheo", "rheo/viscosity", "rheo/pressure", "rheo/thermal", "enforce2d", "add/heat"),
    *("deposit", "evaporate", "print", "halt", "vector", "balance", "momentum", "recenter", "property/atom"),
    *("deform", "dt/reset", "move", "nve", "nve/limit", "temp/rescale", "numdiff"),
    *("ave/time", "ave/atom", "ave/chunk", "ave/histo", "ave/grid", "ave/correlate", "store/state", "store/force"),
)
_HEAT = ("add/heat", "heat/flow", "external", "python/invoke")  # fixes that add to heat flows
_MOVING = ("momentum", "recenter", "deform", "move", "nve", "nve/limit", "temp/rescale")
_STAY = (*(style for style in _NO_FORCE if style not in _MOVING), *_FOLLOWED, "viscous")


def _weights(special: list[str]) -> tuple[list[float], list[float]]:
    """Return the weights of lj and coul that special_bonds gives to pairs of bonded particles; 0 by default."""
    lj, coulomb = [0.0] * 3, [0.0] * 3
    for at, word in enumerate(special):
        if word in ("lj", "coul", "lj/coul"):
            weights = [float(w) for w in special[at + 1 : at + 4]]
            lj = weights if word != "coul" else lj
            coulomb = weights if word != "lj" else coulomb
    return lj, coulomb


# --- commands


def pair_rheo(words: Sequence[str]) -> PairRheo:
    """Read pair_style rheo, alone or among the styles of a hybrid/overlay.

    Raises
    ------
    InputError
    """
    if "rheo" not in words or words[0] not in ("rheo", "hybrid/overlay", "hybrid"):
        raise InputError("pair_style", "must be rheo, or rheo and others", " ".join(words[:2]) or None)
    own = Words(list(words), " ".join(["pair_style", *words]), words.index("rheo") + 1)
    pair = commands.pair_rheo(own)
    if words[0] == "rheo":
        own.end("pair_style rheo")
    return pair


def rheo_words(words: Sequence[str]) -> list[str]:
    """Return the words of pair_style rheo, alone or among the styles of a hybrid/overlay."""
    at = words.index("rheo")
    others = (k for k, word in enumerate(words[at + 1 :], at + 1) if word[:1].isalpha() and word not in _PAIR_WORDS)
    return list(words[at : next(others, len(words))])


def action(words: Sequence[str]) -> Action:
    """Read fix gravity, addforce or setforce with plain numbers.

    Raises
    ------
    InputError
    """
    _, name, group, style, *rest = words
    try:
        if style != "gravity":
            if len(rest) != 3:
                raise ValueError
            vector = tuple(None if style == "setforce" and word == "NULL" else float(word) for word in rest)
            return Action(style, group, vector)
        if len(rest) != 5 or rest[1] != "vector":
            raise ValueError
        size, *direction = (float(word) for word in (rest[0], *rest[2:]))
        return Action(style, group, tuple(size * c / math.hypot(*direction) for c in direction))
    except ValueError:
        raise InputError(f"fix {name} ({style})", "cannot be followed", " ".join(rest)) from None
