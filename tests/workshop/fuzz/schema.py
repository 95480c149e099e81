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
_TYPES: dict[str, tuple[type, ...]] = {
    "null": (type(None),),
    "boolean": (bool,),
    "integer": (int,),
    "number": (int, float),
    "string": (str,),
    "array": (list, tuple),
    "object": (dict,),
}


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


def choices() -> list[str]:
    """Return every choice of the schema."""
    return list(dict.fromkeys(_choices(root(), "", optional=False)))


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


def taken(content: Any, node: Node | None = None, place: str = "", optional: bool = False) -> set[str]:
    """Return the choices that the content of a scene takes."""
    branch = branch_of(content, resolved(root() if node is None else node))
    if content is None:
        return set() if optional else {f"{place}=null"}
    if values_of(branch) is not None:
        return {f"{place}={_word(content)}"}
    places = {place} if place else set()
    if isinstance(content, dict):
        for key, value in content.items():
            child = branch["properties"][key]
            places |= taken(value, child, below(place, key), key not in branch.get("required", ()))
    elif isinstance(content, list | tuple):
        nodes = members(branch)
        for k, value in enumerate(content):
            places |= taken(value, nodes[min(k, len(nodes) - 1)], place)
    return places


def branch_of(content: Any, node: Node) -> Node:
    """Return the alternative of a node that matches a content."""
    return next((each for each in branches(node) if _fits(content, each)), node)


def _fits(content: Any, node: Node) -> bool:
    if (listed := values_of(node)) is not None:
        return any(type(content) is type(value) and content == value for value in listed)
    names = node.get("type", ())
    kinds = [kind for name in ([names] if isinstance(names, str) else names) for kind in _TYPES[name]]
    if isinstance(content, bool) or not isinstance(content, tuple(kinds)):
        return False
    return not isinstance(content, dict) or set(content) <= set(node.get("properties", ()))


def _word(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
