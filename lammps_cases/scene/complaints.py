"""Mistakes in a case file, all at once, in terms of the file: key, rule, value, line and column."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from eos_ref import InputError
from eos_ref.errors import nearest, similar, together
from lammps_cases.records.wording import counted
from lammps_cases.records.yaml_files import FlowText, compose, flow, position
from lammps_cases.scene.values import BrokenRule

Keys = tuple[str | int, ...]  # from the top of the file
MANY = 12  # allowed values of a key, beyond which only the nearest is named
# pydantic's types of errors in terms of YAML: a verb, which alternatives share, and the rest.
RULES = {
    "missing": ("", "is required"),
    "extra_forbidden": ("", "unknown key"),
    "invalid_key": ("", "a key must be a plain word"),
    "bool_parsing": ("must be", "true or false"),
    "bool_type": ("must be", "true or false"),
    "dict_type": ("must hold", "keys with values"),
    "finite_number": ("must be", "a finite number"),
    "float_parsing": ("must be", "a number"),
    "float_type": ("must be", "a number"),
    "greater_than": ("must be", "greater than {gt:g}"),
    "greater_than_equal": ("must be", "at least {ge:g}"),
    "int_from_float": ("must be", "a whole number"),
    "int_parsing": ("must be", "a whole number"),
    "int_parsing_size": ("must be", "a whole number of at most 18 digits"),
    "int_type": ("must be", "a whole number"),
    "less_than": ("must be", "less than {lt:g}"),
    "less_than_equal": ("must be", "at most {le:g}"),
    "list_type": ("must be", "a list"),
    "literal_error": ("must be", "{expected}"),
    "model_type": ("must hold", "keys with values"),
    "string_too_short": ("must have", "at least {min_length} characters"),
    "string_type": ("must be", "text"),
    "too_long": ("must have", "at most {members}"),
    "too_short": ("must have", "at least {members}"),
    "tuple_type": ("must be", "a list"),
}


@dataclass(frozen=True)
class Complaint:
    """A rule that a part of a case file breaks.

    Attributes
    ----------
    rules : what is valid, by verb (or none); any of them will do
    below : keys in that part that the rules concern
    words : those that are allowed, if the rule is a choice of words
    mark : line and column, from 0
    case : the case of a matrix that breaks it
    """

    keys: Keys
    rules: tuple[tuple[str, str], ...]
    found: Any = None
    kind: str = ""
    below: Keys = ()
    words: tuple[str, ...] = ()
    mark: tuple[int, int] = (0, 0)
    case: str = ""

    @property
    def rule(self) -> str:
        """Return the rules as a sentence, joining rules that share a verb."""
        (verb, _), *_ = self.rules
        more = (text if each == verb else f"{each} {text}".strip() for each, text in self.rules)
        either = f"{verb} {' or '.join(more)}".strip()
        return re.sub(r"(?<=') or (?='[^']*' or ')", ", ", either)  # for words in a choice within a choice

    @property
    def what(self) -> str:
        """Return the key as named in messages: from the scene on."""
        return ".".join(map(str, self.keys[self.keys[:1] == ("scene",) :])) or "scene"


@dataclass(frozen=True)
class Combination:
    """A scene that a file makes, as written: its case, the labels of the matrix, tags."""

    case: str
    labels: tuple[str, ...]
    content: dict[str, Any]
    tags: tuple[str, ...]


class Source:
    """A case file's text, for the line numbers of its content."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @cached_property
    def _root(self) -> yaml.Node:
        return compose(self.path)

    def place(self, keys: Keys, labels: Sequence[str] = (), at_key: bool = False) -> str:
        """Return file, line and column of a value, as `mark` does, for messages."""
        return self.said(self.mark(keys, labels, at_key))

    def said(self, mark: tuple[int, int]) -> str:
        """Return file, line and column for messages."""
        return f"{self.path}, {position(*mark)}"

    def mark(self, keys: Keys, labels: Sequence[str] = (), at_key: bool = False) -> tuple[int, int]:
        """Return line and column, from 0, of a value or of its key, or of the mapping that lacks it.

        Parameters
        ----------
        labels : of the patches that a matrix applies to the scene
        """
        nodes, mark = [self._root], self._root.start_mark
        for depth, part in enumerate(keys, 1):
            key, nodes = _below(nodes, part)
            if part == "scene" and depth == 1:
                nodes += self._patches(labels)
            if not nodes:
                break
            of_key = at_key or depth < len(keys) or isinstance(nodes[-1], yaml.MappingNode)
            mark = key.start_mark if key is not None and of_key else nodes[-1].start_mark
        return mark.line, mark.column

    def key(self, key: str, labels: Sequence[str]) -> str:
        """Return file, line and column of a key of a scene or of its positions, or else of the positions."""
        mark = self.mark(("scene", key), labels)
        if mark == self.mark(("scene",), labels):  # no such key
            mark = self.mark(("scene", "positions", key), labels)
        return f"{self.path.name}, {position(*mark)}"

    def _patches(self, labels: Sequence[str]) -> list[yaml.Node]:
        _, axes = _below([self._root], "matrix")
        of_axes = [axis for _, axis in axes[0].value] if axes and isinstance(axes[0], yaml.MappingNode) else []
        return [node for axis, label in zip(of_axes, labels, strict=False) for node in _below([axis], label)[1]]


def _below(nodes: Sequence[yaml.Node], part: str | int) -> tuple[yaml.Node | None, list[yaml.Node]]:
    """Return the last node of a key and the nodes of its value, in mappings each of which patches those before.

    As in `lammps_cases.scene.casefile.merge`, mappings are joined, ``key+`` is appended to a list,
    and anything else replaces the old value.
    """
    if isinstance(part, int):
        members = [each for node in nodes if isinstance(node, yaml.SequenceNode) for each in node.value]
        return None, members[part : part + 1]
    last, nodes_there = None, list[yaml.Node]()
    for node in nodes:
        for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
            if key.value not in (part, f"{part}+"):
                continue
            joined = key.value != part or isinstance(value, yaml.MappingNode)
            last, nodes_there = key, [*nodes_there, value] if joined else [value]
    return last, nodes_there


# --- what pydantic finds


def complaints(error: ValidationError, content: Any, source: Source) -> list[Complaint]:
    """Return pydantic's errors about a file, or about a scene that it makes."""
    made = content if isinstance(content, Combination) else None
    content, under, labels = (content, (), ()) if made is None else (made.content, ("scene",), made.labels)
    case = made.case if made and labels else ""
    grouped: dict[tuple[Keys, str], list[Complaint]] = {}
    for each in error.errors(include_url=False):
        keys, alternative = _keys(each["loc"], content, each["type"])
        grouped.setdefault((keys[: alternative[0]], alternative[1]), []).append(_complaint(each, (*under, *keys)))
    best: dict[Keys, list[list[Complaint]]] = {}
    for (place, _), of_alternative in grouped.items():
        best.setdefault(place, []).append(of_alternative)
    wrong: list[Complaint] = []
    for alternatives in best.values():  # for a value with alternatives: the one with the fewest errors
        least = min(map(len, alternatives))
        wrong += [each for alternative in alternatives if len(alternative) == least for each in alternative]
    at_key = ("extra_forbidden", "invalid_key")
    return [
        replace(each, mark=source.mark((*each.keys, *each.below), labels, each.kind in at_key), case=case)
        for each in _one_each(wrong)
    ]


def _keys(loc: tuple[str | int, ...], content: Any, kind: str) -> tuple[Keys, tuple[int, str]]:
    """Return the keys of pydantic's location, and the alternative that it concerns, with the keys before that.

    Parts of the location that are not keys of the content are pydantic's names of alternatives and validators.
    """
    keys: list[str | int] = []
    alternative = (0, "")
    for at, part in enumerate(loc):
        inside = _holds(content, part)
        if inside:
            content = content[part]
        if inside or (kind == "missing" and at == len(loc) - 1):
            keys.append(part)
        else:
            alternative = len(keys), str(part)
    return tuple(keys), alternative


def _holds(content: Any, part: str | int) -> bool:
    if isinstance(content, list | tuple):
        return isinstance(part, int) and part < len(content)
    return isinstance(content, Mapping) and part in content


def _complaint(error: ErrorDetails, keys: Keys) -> Complaint:
    kind, value = error["type"], error.get("input")
    context = error.get("ctx", {})
    if kind == "missing" and isinstance(keys[-1], int):
        return Complaint(keys[:-1], (("must have", counted(keys[-1] + 1, "member")),), value)
    if kind == "value_error":
        return _of_validator(context["error"], keys, value)
    if kind == "literal_error":
        context = {"expected": context["expected"].replace("True", "true")}
    members = counted(context.get("min_length", context.get("max_length", 0)), "member")
    verb, rest = RULES.get(kind, ("", error["msg"]))
    found = None if kind in ("missing", "extra_forbidden") else flow(value)
    words = tuple(re.findall("'([^']*)'", context.get("expected", "")))
    return Complaint(keys, ((verb, rest.format(**context, members=members)),), found, kind, words=words)


def _of_validator(error: ValueError, keys: Keys, value: Any) -> Complaint:
    """Format a validation error: a rule of a scene, or of the reference's input."""
    if not isinstance(error, BrokenRule):  # its text includes the value
        return Complaint(keys, (("", str(error)),))
    found = flow(value) if error.found is None and not isinstance(value, dict) else error.found
    shown = found if error.found is None else FlowText(found)
    return Complaint(keys, (("", error.rule),), shown, below=_inside(error.at, value))


def _inside(path: Keys, content: Any) -> Keys:
    """Return the leading keys that exist in a content."""
    keys: Keys = ()
    for part in path:
        if not _holds(content, part):
            break
        keys, content = (*keys, part), content[part]
    return keys


def _one_each(every: Sequence[Complaint]) -> list[Complaint]:
    """Return one complaint for each part of the file."""
    by_keys: dict[Keys, Complaint] = {}
    for each in every:
        before = by_keys.setdefault(each.keys, each)
        rules, words = dict.fromkeys((*before.rules, *each.rules)), dict.fromkeys((*before.words, *each.words))
        by_keys[each.keys] = replace(before, rules=tuple(rules), words=tuple(words))
    return list(by_keys.values())


def _with_hint(complaint: Complaint) -> Complaint:
    hint = nearest(str(complaint.found), complaint.words)
    rule = "must be a known name" if hint and len(complaint.words) > MANY else complaint.rule
    return replace(complaint, rules=(("", rule + hint),))


# --- unknown keys


def places(schema: Mapping[str, Any]) -> list[Keys]:
    """Return the places of all keys that a case file can hold, without the indices of lists, from its schema."""

    def below(node: Mapping[str, Any], place: Keys) -> Iterator[Keys]:
        node = schema["$defs"][node["$ref"].rpartition("/")[2]] if "$ref" in node else node
        children = node.get("properties", {})
        yield from ((*place, key) for key in children)
        for key, child in children.items():
            yield from below(child, (*place, key))
        members = [node["items"]] if "items" in node else []
        for part in (*node.get("anyOf", ()), *node.get("oneOf", ()), *node.get("prefixItems", ()), *members):
            yield from below(part, place)

    return list(dict.fromkeys(below(schema, ())))


def explained(every: Sequence[Complaint], allowed: Sequence[Keys]) -> list[Complaint]:
    """Return complaints with unknown keys first, with suggestions; a suggested key is not reported as missing, too."""
    missing = {each.keys for each in every if each.kind == "missing"}
    first, meant = list[Complaint](), set[Keys]()
    for each in every:
        if each.kind == "extra_forbidden":
            hint, key = _meant(each.keys, missing, allowed)
            first.append(replace(each, rules=(("", each.rule + hint),)))
            meant.add(key)
    others = [
        _with_hint(each) if each.kind == "literal_error" else each
        for each in every
        if each.kind != "extra_forbidden" and each.keys not in meant
    ]
    # A list that is too short may just have bad members.
    above = {each.keys[:at] for each in others for at in range(len(each.keys))}
    rest = [each for each in others if each.kind != "too_short" or each.keys not in above]
    return [each for part in (first, rest) for each in sorted(part, key=lambda each: each.mark)]


def _meant(keys: Keys, missing: set[Keys], allowed: Sequence[Keys]) -> tuple[str, Keys]:
    """Return the hint for an unknown key, and the key that was probably meant.

    In this order: a similar key missing at its level, the same key at another level, any similar one at its level.
    """
    *parent, last = keys
    name = str(last)
    wanted = [str(key[-1]) for key in missing if key[:-1] == tuple(parent)]
    homes = [place[:-1] for place in allowed if place[-1] == name]
    homes = [home for home in homes if (*home, name) in missing] or homes
    key = similar(name, wanted)
    if not key and 1 <= len(homes) <= 2:
        under = " or ".join(
            f"{'.'.join(map(str, home[len(home) > 1 :]))}:" if home else "no other key" for home in homes
        )
        return f" (belongs under {under})", (*homes[0], name)
    level = tuple(part for part in parent if isinstance(part, str))
    key = key or similar(name, sorted(str(place[-1]) for place in allowed if place[:-1] == level))
    return nearest(name, [key]), (*parent, key) if key else ()


def refused(every: Sequence[Complaint], source: Source) -> InputError:
    """Return complaints about a file as one exception, merged by location: each location once, for its first case."""
    once: dict[tuple[Any, ...], InputError] = {}
    for each in every:
        place = source.said(each.mark) + (f", case {each.case}" if each.case else "")
        once.setdefault((each.mark, each.keys, each.rule), InputError(each.what, each.rule, each.found, place))
    return together(list(once.values()))
