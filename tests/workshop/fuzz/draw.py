"""The strategy of random scenes over the whole schema, and the scenes that a seed gives."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import hypothesis
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from eos_ref import InputError
from eos_ref.model.units import UNITS
from eos_ref.syntax.manual import Manual
from lammps_cases.run.prepared_case import PreparedCase, prepare
from lammps_cases.scene import Scene
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.values import Path as Place
from lammps_cases.scene.values import Powers, changed
from lammps_cases.setup.twins import Scale
from tests.workshop.fuzz import schema
from tests.workshop.fuzz.drawing import Content, Drawing, rounded
from tests.workshop.fuzz.fit import Fit, fitted
from tests.workshop.fuzz.rules import COMMON, GIVEN, RULES

SOURCE = Path("drawn.yaml")


@dataclass(frozen=True)
class DrawnScene:
    """A scene that was drawn.

    Attributes
    ----------
    content : the scene as a case file has it
    ready : its case, with particles
    rejected : why earlier attempts were invalid
    """

    seed: int
    number: int
    content: Content
    ready: PreparedCase
    rejected: tuple[str, ...]

    @property
    def case(self) -> Case:
        """Return the case."""
        return self.ready.case

    def by(self, manual: Manual) -> DrawnScene:
        """Return the draw with the manual's version that the reference is to follow."""
        return replace(self, ready=prepare(self.case.by(manual)))

    @property
    def choices(self) -> set[str]:
        """Return the choices of the schema that it takes."""
        return schema.taken(self.content)


@st.composite
def contents(draw: st.DrawFn) -> tuple[Content, Fit]:
    """Draw the content of a scene, which may break rules that the schema does not contain, and what fits it."""
    s = Drawing(draw, RULES, GIVEN, COMMON)
    content = s.object("")
    far = s.coin(0.15)
    length, density, sound = (s.number(1e-3, 1e3) if far else s.number(*ends) for ends in ((0.5, 2), (0.5, 2), (3, 20)))
    # Not given, both are 1.
    density = density if all("rho0" in t for t in content["types"]) else 1.0
    sound = sound if all("cs" in t for t in content["types"]) else 1.0
    which = s.share()
    share = s.number(*((0.02, 0.5) if which < 0.85 else (0.5, 1.0) if which < 0.98 else (1.5, 4.0)))
    fit = Fit(share, kernel=s.choice(["quintic", "RK0"]), zmin=s.coin(0.2))
    return scaled(content, length, density, sound), fit


def scaled(content: Content, length: float, density: float, sound: float) -> Content:
    """Return a content of another size, in the numbers of its units; a growing box keeps its shares.

    Raises
    ------
    ValidationError
        It is no scene.
    """
    scene = Scene.model_validate(content)
    mass, time = density * length**scene.dimension, length / sound
    scale = Scale(scene.dimension, length, mass, time, UNITS["lj"], UNITS[scene.units])

    def number(place: Place, value: float, powers: Powers) -> float:
        other = value if place[:2] == ("evolve", "deform") else scale.scaled(value, powers)
        return value if other == value else rounded(other, 6)

    made: Content = changed(scene, number).model_dump(mode="json", exclude_unset=True)
    return made


def draw(seed: int, number: int) -> DrawnScene:
    """Return a scene, always the same for a seed and a number (and a release of hypothesis).

    Raises
    ------
    InputError
        All of many attempts were invalid: a rule contradicts the schema.
    """
    rejected: list[str] = []
    found: list[DrawnScene] = []

    @hypothesis.seed(int.from_bytes(hashlib.sha256(f"{seed}/{number}".encode()).digest()))
    @settings(max_examples=1, database=None, deadline=None, phases=[Phase.generate], suppress_health_check=HealthCheck)
    @given(st.data())
    def keep(data: st.DataObject) -> None:
        assume(data.draw(st.booleans()))  # hypothesis begins with the simplest scene of all
        try:
            content, ready = fitted(*data.draw(contents()), partial(_prepared, seed, number))
        except (InputError, ValidationError) as error:
            rejected.append(_reason(error))
            hypothesis.reject()
        found.append(DrawnScene(seed, number, content, ready, tuple(rejected)))

    try:
        keep()
    except hypothesis.errors.Unsatisfiable:
        rule = f"no valid scene in {len(rejected)} attempts, the last rejected for: {rejected[-1]}"
        raise InputError("draw", rule, number) from None
    return found[0]


def _reason(error: InputError | ValidationError) -> str:
    if isinstance(error, InputError):
        return f"{error.what}: {error.rule}"
    first = error.errors(include_url=False)[0]
    return ".".join(map(str, first["loc"])) + ": " + first["msg"]


def draws(seed: int, first: int = 0) -> Iterator[DrawnScene]:
    """Yield the draws of a seed endlessly."""
    return (draw(seed, number) for number in itertools.count(first))


def _prepared(seed: int, number: int, content: Content) -> PreparedCase:
    """Return the case of a content.

    Raises
    ------
    InputError, ValidationError
        It is not a valid scene.
    """
    about = f"Drawn at random: make fuzz FUZZ='--seed {seed} --draw {number}'."
    case = Case(f"drawn-{seed}-{number}", about, ("drawn",), Scene.model_validate(content), SOURCE, shipped=False)
    return prepare(case)
