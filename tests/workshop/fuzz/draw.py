"""Draw scenes over the whole schema: by rules if there are any, else from the schema itself."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from eos_ref import InputError
from eos_ref.syntax.manual import Manual
from lammps_cases.run.prepared_case import PreparedCase, prepare
from lammps_cases.scene import Scene
from lammps_cases.scene.casefile import Case
from tests.workshop.fuzz import schema
from tests.workshop.fuzz.chance import Chance
from tests.workshop.fuzz.fit import fitted
from tests.workshop.fuzz.rules import GIVEN, HANDLED, LEFT_OUT, NEVER, RULES, type_range
from tests.workshop.fuzz.scope import Content, Scope

OPTIONAL = 0.35  # probability of a key without a rule
ATTEMPTS = 50
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


def draw(seed: int, number: int) -> DrawnScene:
    """Return a scene, always the same for a seed and a number.

    Raises
    ------
    InputError
        All of many attempts were invalid: a rule contradicts the schema.
    """
    rejected: list[str] = []
    for attempt in range(ATTEMPTS):
        name = f"{seed}/{number}" + f"/{attempt}" * bool(attempt)
        try:
            chance = Chance(name)
            content, ready = fitted(content_of(chance), chance.at("fit"), partial(_prepared, seed, number))
        except InputError as error:
            rejected.append(f"{error.what}: {error.rule}")
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            rejected.append(".".join(map(str, first["loc"])) + ": " + first["msg"])
        else:
            return DrawnScene(seed, number, content, ready, tuple(rejected))
    raise InputError("draw", f"no valid scene in {ATTEMPTS} attempts, the last rejected for: {rejected[-1]}", number)


def draws(seed: int, first: int = 0) -> Iterator[DrawnScene]:
    """Yield the draws of a seed endlessly."""
    for number in itertools.count(first):
        yield draw(seed, number)


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


def content_of(chance: Chance) -> Content:
    """Return the content of a scene; it may break rules that the schema does not contain."""
    scope = Scope(chance)
    for key in schema.root()["properties"]:
        value = drawn_property(scope, chance, schema.root(), key, "")
        if value is not LEFT_OUT:
            scope.content[key] = value
    return scope.content


def drawn_property(scope: Scope, chance: Chance, node: schema.Node, key: str, place: str) -> Any:
    """Return the value of a key of an object, or `LEFT_OUT`; ``chance`` is the object's."""
    own, place = chance.at(key), schema.below(place, key)
    required = key in node.get("required", ())
    if place in NEVER or not (required or own.coin(GIVEN.get(place, OPTIONAL))):
        return LEFT_OUT
    return drawn_value(scope, own, schema.resolved(node["properties"][key]), place)


def drawn_value(scope: Scope, chance: Chance, node: schema.Node, place: str) -> Any:
    """Return a value of a node of the schema, or `LEFT_OUT`."""
    if place in RULES:
        return _completed(scope, chance, RULES[place](scope, chance), node, place)
    branch = chance.choice([each for each in schema.branches(node) if each.get("type") != "null"])
    if (values := _possible(branch, place)) is not None:
        return chance.choice(values) if values else LEFT_OUT
    if schema.is_range(branch):
        return type_range(scope, chance)
    match branch.get("type"):
        case "object":
            return _object(scope, chance, branch, place)
        case "array":
            return _array(scope, chance, branch, place)
        case "integer":
            return chance.whole(*_whole_limits(branch))
        case "number":
            return chance.number(*_limits(branch))
    return LEFT_OUT  # text, or anything that needs a rule


def _possible(node: schema.Node, place: str) -> list[Any] | None:
    values = schema.values_of(node)
    return None if values is None else [v for v in values if f"{place}={v}" not in NEVER]


def _object(scope: Scope, chance: Chance, node: schema.Node, place: str) -> Content:
    return _with_keys(scope, chance, {}, node, place, node["properties"])


def _array(scope: Scope, chance: Chance, node: schema.Node, place: str) -> list[Any]:
    nodes = schema.members(node)
    if "prefixItems" not in node:
        low, high = node.get("minItems", 1), node.get("maxItems", 3)
        vector = (low, high) == (2, 3) and nodes[0].get("type") == "number"
        nodes = nodes * (scope.d if vector else chance.whole(max(1, low), min(3, high)))
    values = [drawn_value(scope, chance.at(k), each, place) for k, each in enumerate(nodes)]
    return [value for value in values if value is not LEFT_OUT]


def _whole_limits(node: schema.Node) -> tuple[int, int]:
    low = int(node.get("minimum", node.get("ge", node.get("exclusiveMinimum", 0))))
    return low, int(node.get("maximum", node.get("le", low + 5)))


def _limits(node: schema.Node) -> tuple[float, float]:
    high = float(node.get("maximum", node.get("le", 3.0)))
    return high / 10, high


def _completed(scope: Scope, chance: Chance, value: Any, node: schema.Node, place: str) -> Any:
    """Return the value of a rule, completed by the keys of the schema that the rule does not set."""
    if place not in HANDLED or value is LEFT_OUT:
        return value
    if isinstance(value, list):
        (member,) = schema.members(node)
        return [_with_other_keys(scope, chance.at(k), each, member, place) for k, each in enumerate(value)]
    return _with_other_keys(scope, chance, value, schema.branch_of(value, node), place)


def _with_other_keys(scope: Scope, chance: Chance, value: Content, node: schema.Node, place: str) -> Content:
    return _with_keys(
        scope, chance, value, node, place, [key for key in node["properties"] if key not in HANDLED[place]]
    )


def _with_keys(
    scope: Scope, chance: Chance, value: Content, node: schema.Node, place: str, keys: Iterable[str]
) -> Content:
    drawn = ((key, drawn_property(scope, chance, node, key, place)) for key in keys)
    return value | {key: each for key, each in drawn if each is not LEFT_OUT}
