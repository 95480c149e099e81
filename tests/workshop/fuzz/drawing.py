"""Draw a scene from its schema: every key by its kind, or by a rule where values have to agree (`rules`).

Lengths are drawn in spacings, masses in those of a particle, times in what sound takes for a spacing; the annotations
of the scene's numbers scale them (`tests.workshop.fuzz.draw`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeVar

from hypothesis import strategies as st

from tests.workshop.fuzz import schema

T = TypeVar("T")
Content = dict[str, Any]
LEFT_OUT: Final = object()
OPTIONAL = 0.35  # probability of a key that no rule gives another
FORMS = ("*", "n", "*n", "m*", "m*n")  # of a range of types
# For larger whole numbers hypothesis also tries those in our sources: draws would depend on the modules imported.
HUNDRED = st.integers(0, 99)


def rounded(value: float, digits: int = 3) -> float:
    """Round a number to a few significant digits: the last bit of a power differs from one machine to another."""
    return float(f"{value:.{digits - 1}e}")


class Drawing:
    """A scene as it is drawn: what hypothesis chooses, the keys so far, and what several of them depend on.

    Parameters
    ----------
    draw : draws from a strategy
    rules : numbers of some places, by a range or a function of the drawing and the part of the scene so far
    chances : probabilities that an optional key is given, and of what several keys depend on
    """

    def __init__(self, draw: st.DrawFn, rules: Mapping[str, Rule], *chances: Mapping[str, float]) -> None:
        self._draw, self._rules = draw, rules
        self._given, self._common = chances
        self._drawn: dict[str, Any] = {}
        self.content: Content = {}

    # --- numbers

    def share(self) -> float:
        """Return a number from 0 to 1."""
        return float(self._draw(HUNDRED) + self._draw(HUNDRED) / 99) / 100

    def coin(self, probability: float = 0.5) -> bool:
        """Return true with a probability."""
        return bool(self._draw(HUNDRED) >= 100 * (1 - probability))

    def whole(self, low: int, high: int) -> int:
        """Return a whole number, both ends included."""
        return int(self._draw(st.integers(low, high)))

    def choice(self, values: Sequence[T]) -> T:
        """Return one of some values."""
        return values[self.whole(0, len(values) - 1)]

    def some(self, values: Sequence[T], probability: float) -> list[T]:
        """Return each of some values with a probability, in their order."""
        return [value for value in values if self.coin(probability)]

    def number(self, low: float, high: float) -> float:
        """Return a positive number, distributed uniformly in its logarithm."""
        return rounded(low * (high / low) ** self.share())

    def between(self, low: float, high: float) -> float:
        """Return a number, distributed uniformly."""
        return rounded(low + self.share() * (high - low))

    def vector(self, size: float) -> list[float]:
        """Return components of a size up to the one given; some are 0."""
        return [0.0 if self.coin(0.15) else self.between(-size, size) for _ in range(self.d)]

    def type_range(self) -> str | int:
        """Return a range of types in one of the forms of the manual; a single one as a number or as text."""
        low = self.whole(1, self.count)
        high = self.whole(low, self.count)
        form = self.choice(FORMS)
        if form == "n" and self.coin():
            return low
        return form.replace("m", str(low)).replace("n", str(low if form == "n" else high))

    # --- what several keys depend on

    def gives(self, what: str) -> bool:
        """Return whether all parts of the scene have something."""
        return bool(self.once(what, lambda: self.coin(self._common[what])))

    def once(self, what: str, draw: Callable[[], T]) -> T:
        """Return what is drawn once for the whole scene."""
        if what not in self._drawn:
            self._drawn[what] = draw()
        value: T = self._drawn[what]
        return value

    @property
    def d(self) -> int:
        """Dimension."""
        return int(self.content["dimension"])

    @property
    def count(self) -> int:
        """Number of types."""
        return len(self.content["types"])

    def part(self, key: str) -> Any:
        """Return a part of the scene; empty if it is not given."""
        return self.content.get(key, {})

    # --- by the schema

    def object(self, place: str, part: Content | None = None, key: str = "") -> Content:
        """Return an object, or a member of a list: some keys given, the others drawn; ``key`` tells alternatives."""
        part, node = {} if part is None else part, schema.object_at(place, key)
        if not place:
            self.content = part
        for key in node["properties"]:
            below, optional = schema.below(place, key), key not in node.get("required", ())
            if key in part or (optional and not self.coin(self._given.get(below, OPTIONAL))):
                continue
            value = self.value(schema.resolved(node["properties"][key]), below, part)
            if value is not LEFT_OUT:
                part[key] = value
        return part

    def value(self, node: schema.Node, place: str, part: Content, by_rule: bool = True) -> Any:
        """Return a value of a node of the schema, or `LEFT_OUT`."""
        rule = self._rules.get(place)
        if by_rule and callable(rule):
            return rule(self, part)
        branch = self.choice([each for each in schema.branches(node) if each.get("type") != "null"])
        if (values := schema.values_of(branch)) is not None:
            return self.choice(values)
        if schema.is_range(branch):
            return self.type_range()
        match branch.get("type"):
            case "object":
                return self.object(place)
            case "array":
                return self._array(branch, place, part)
            case "integer":
                low = branch.get("minimum", branch.get("exclusiveMinimum", 0))
                return self.whole(low, branch.get("maximum", low + 5))
            case "number":
                high = float(branch.get("maximum", branch.get("exclusiveMaximum", 3.0)))
                low, high = rule if isinstance(rule, tuple) else (high / 10, high)
                return 0.0 if branch.get("minimum") == 0 and self.coin(0.07) else self.number(low, high)
        return LEFT_OUT  # text

    def _array(self, node: schema.Node, place: str, part: Content) -> list[Any]:
        nodes = schema.members(node)
        if "prefixItems" not in node:
            low, high = node.get("minItems", 1), node.get("maxItems", 3)
            vector = (low, high) == (2, 3) and nodes[0].get("type") == "number"
            nodes = nodes * (self.d if vector else self.whole(max(1, low), min(3, high)))
        values = [self.value(each, place, part, by_rule=False) for each in nodes]
        return [value for value in values if value is not LEFT_OUT]


Rule = tuple[float, float] | Callable[[Drawing, Content], Any]
