"""The schema of a scene as places and choices, and which of them a scene takes.

A place is a path of keys: ``rheo.shift.exclude``; members of a list share the place of the list. A choice is a place,
or a place with one of its values: ``rheo.kernel=RK1``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from lammps_cases.scene import Scene
from lammps_cases.scene.values import RANGE_SCHEMA

Node = Mapping[str, Any]


@cache
def root() -> Node:
    """Return the JSON schema of a scene."""
    schema: Node = Scene.model_json_schema()
    return schema


def resolved(node: Node) -> Node:
    """Return a node of the schema, followed to the definition that it refers to."""
    while "$ref" in node:
        rest = {key: value for key, value in node.items() if key != "$ref"}
        node = {**root()["$defs"][node["$ref"].rpartition("/")[2]], **rest}
    return node


def branches(node: Node) -> list[Node]:
    """Return the alternatives of a node; itself if it has none."""
    options = node.get("anyOf") or node.get("oneOf")
    return [resolved(each) for each in options] if options else [node]


def values_of(node: Node) -> list[Any] | None:
    """Return the values that a node lists; None if it does not."""
    if "const" in node:
        return [node["const"]]
    if "enum" in node:
        return list(node["enum"])
    return [True, False] if node.get("type") == "boolean" else None


def is_range(node: Node) -> bool:
    """Return whether a node is a range of types."""
    return node.get("type") == RANGE_SCHEMA["type"]


def members(node: Node) -> list[Node]:
    """Return the nodes of the members of a list: one of all, or one each."""
    return [resolved(each) for each in node.get("prefixItems") or [node.get("items", {})]]


def below(place: str, key: str) -> str:
    """Return the place of a key."""
    return f"{place}.{key}" if place else key


@cache
def choices() -> list[str]:
    """Return every choice of the schema."""
    return list(dict.fromkeys(_choices(root(), "", optional=False)))


def options(place: str) -> list[str]:
    """Return the words listed at a place."""
    above, _, key = place.rpartition(".")
    node = resolved(object_at(above, key)["properties"][key])
    return [value for branch in branches(node) for value in values_of(branch) or ()]


def object_at(place: str, key: str = "") -> Node:
    """Return the object at a place, or that of the members of a list; of several alternatives the one with a key."""
    node = root()
    for name in filter(None, place.split(".")):
        node = next(each for each in _objects(node) if name in each["properties"])["properties"][name]
    return next(each for each in _objects(node) if not key or key in each["properties"])


def _objects(node: Node) -> Iterator[Node]:
    for branch in branches(resolved(node)):
        if branch.get("type") == "object":
            yield branch
        elif branch.get("type") == "array":
            yield from (each for member in members(branch) for each in _objects(member))


def _choices(node: Node, place: str, optional: bool) -> Iterator[str]:
    for branch in branches(resolved(node)):
        if branch.get("type") == "null":
            if not optional:  # otherwise the key is not given
                yield f"{place}=null"
        elif (listed := values_of(branch)) is not None:
            yield from (f"{place}={_word(value)}" for value in listed)
        elif branch.get("type") == "object":
            yield from [place] if place else []
            for key, child in branch["properties"].items():
                yield from _choices(child, below(place, key), key not in branch.get("required", ()))
        elif branch.get("type") == "array":
            yield place
            for member in members(branch):
                yield from _choices(member, place, optional=False)
        else:
            yield place


def taken(content: Any) -> set[str]:
    """Return the choices that the content of a scene takes."""
    known = set(choices())

    def below_place(part: Any, place: str) -> Iterator[str]:
        value = f"{place}={_word(part)}"
        yield value if part is None or isinstance(part, bool) or value in known else place
        if isinstance(part, dict):
            for key, each in part.items():
                yield from below_place(each, below(place, key))
        elif isinstance(part, list | tuple):
            for each in part:
                yield from below_place(each, place)

    return known.intersection(below_place(content, ""))


def _word(value: Any) -> str:
    return "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
