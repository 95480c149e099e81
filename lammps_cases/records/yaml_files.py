"""YAML files: safe types only, numbers of YAML 1.2, no repeated key; the base of statements of the manual.

PyYAML's parser in C reads all shipped case files in a fourteenth of the time of ruamel.yaml, which does all
of this by itself but in Python: 0.07 s against 1.0 s, with 1.5 s for the whole of ``eos-ref list``.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, model_validator

from eos_ref.errors import InputError
from eos_ref.syntax.manual import FIRST, MANUALS, Manual
from lammps_cases.records.files import MIB, read_text

DECK = re.compile(r"^\s*(units|atom_style|pair_style|fix|run)[ \t]+\w", re.MULTILINE)  # commands of LAMMPS
MOST_SHOWN = 80  # characters of a value in a complaint
LARGEST = 32 * MIB
DEEPEST = 40  # levels of a document
MOST_ALIASED = 100_000  # parts that aliases stand for, counted at every reference
LONGEST_NUMBER = 400  # characters
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _UniqueKeys(_Loader):  # type: ignore[misc]
    """YAML's safe loader, which rejects a repeated key."""


def _mapping(loader: Any, node: Any, deep: bool = False) -> dict[Any, Any]:
    mapping: dict[Any, Any] = {}
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        try:
            repeated = key in mapping
        except TypeError:
            raise yaml.constructor.ConstructorError(
                None, None, "a key must be a plain word", key_node.start_mark
            ) from None
        if repeated:
            raise yaml.constructor.ConstructorError(None, None, f"repeated key {key!r}", key_node.start_mark)
        mapping[key] = loader.construct_object(value_node, deep=True)
    return mapping


# YAML 1.2 numbers: PyYAML reads 1e-12 as text, as it has neither a point nor a signed exponent.
_FLOAT = ("tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+"), list("-+.0123456789"))
_UniqueKeys.add_implicit_resolver(*_FLOAT)
_UniqueKeys.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


class FlowText(str):
    """A value as in its file, which complaints show without quotes."""

    __repr__ = str.__str__


def flow(value: Any) -> Any:
    """Return a value as complaints show it: words of YAML (null, true, {a: 1}); text and numbers are not changed."""
    if isinstance(value, str | int | float) and not isinstance(value, bool):
        return value
    text = yaml.dump(value, Dumper=_Writer, sort_keys=False, default_flow_style=True, width=math.inf)
    text = text.removesuffix("\n").removesuffix("\n...")
    return FlowText(text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]} ...")


class _Writer(yaml.SafeDumper):
    """YAML's safe writer, which quotes a text that `read_yaml` would read as a number."""


_Writer.add_implicit_resolver(*_FLOAT)


def yaml_text(data: Any) -> str:
    """Return data as YAML that `read_yaml` reads back unchanged: keys in order, small parts in one line."""
    text: str = yaml.dump(data, Dumper=_Writer, sort_keys=False, default_flow_style=None, width=110)
    return text


def position(line: int, column: int) -> str:
    """Return the position of a mark, which counts from 0, in words."""
    return f"line {line + 1}, column {column + 1}"


def _refused(rule: str, event: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=rule, problem_mark=event.start_mark)


def _check_size(text: str) -> None:
    """Check that a document is no deeper and, with its aliases written out, no larger than a hand-written one.

    Raises
    ------
    yaml.MarkedYAMLError
    """
    open_parts: list[tuple[str | None, int]] = []  # anchor, and parts before
    size_of: dict[str, int] = {}
    parts = aliased = 0
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in size_of:
                raise _refused("an alias must come after what it stands for", event)
            aliased += size_of[event.anchor]
            parts += size_of[event.anchor]
            if aliased > MOST_ALIASED:
                raise _refused(f"aliases must stand for at most {MOST_ALIASED} parts", event)
        elif isinstance(event, yaml.CollectionStartEvent):
            open_parts.append((event.anchor, parts))
            parts += 1
            if len(open_parts) > DEEPEST:
                raise _refused(f"must be at most {DEEPEST} levels deep", event)
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_parts.pop()
            size_of |= {anchor: parts - before} if anchor else {}
        elif isinstance(event, yaml.ScalarEvent):
            parts += 1
            size_of |= {event.anchor: 1} if event.anchor else {}
            if len(event.value) > LONGEST_NUMBER and event.implicit[0] and event.value[0] in "+-.0123456789":
                raise _refused(f"a number must have at most {LONGEST_NUMBER} digits", event)


def compose(path: Path) -> yaml.Node:
    """Return a non-empty file that `read_yaml` accepts as nodes, each with line and column."""
    node = yaml.compose(read_text(path, "case file", LARGEST), _Loader)
    assert node is not None
    return node


def if_deck(path: Path, text: str) -> str:
    """Return a hint if a file is plainly an input of LAMMPS and not YAML."""
    return (
        f" (a LAMMPS input? eos-ref audit {path.name})"
        if path.suffix not in (".yaml", ".yml") and DECK.search(text)
        else ""
    )


def read_yaml(path: Path, what: str = "case file") -> Any:
    """Read the data of a YAML file; ``what`` is its name in complaints.

    Raises
    ------
    InputError
        Unreadable, not UTF-8, not YAML, or a repeated key.
    """
    return parse_yaml(read_text(path, what, LARGEST), path, what)


def parse_yaml(text: str, path: Path, what: str) -> Any:
    """Return the data of the text of a file, or of its beginning; raises as `read_yaml`."""
    try:
        _check_size(text)
        return yaml.load(text, _UniqueKeys)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f"{path}, {position(mark.line, mark.column)}" if mark else str(path)
        tab = mark and "".join(text.split("\n")[mark.line : mark.line + 1])[mark.column : mark.column + 1] == "\t"
        problem = "tabs do not indent, spaces do" if tab else error.problem
        raise InputError(what, f"is not valid YAML: {problem}{if_deck(path, text)}", where=line) from None
    except (yaml.YAMLError, ValueError, AttributeError, RecursionError) as error:  # a tag that does not fit its text
        raise InputError(what, f"is not valid YAML: {error}", where=str(path)) from None


class OfManual(BaseModel):
    """A statement of the manual that may be limited to some versions.

    Attributes
    ----------
    since, until : the first and the last version of the manual with it; by default the oldest and the newest
    """

    since: Manual = FIRST
    until: Manual = MANUALS[-1]

    @model_validator(mode="after")
    def _in_order(self) -> OfManual:
        if MANUALS.index(self.since) > MANUALS.index(self.until):
            raise ValueError("since must not be later than until")
        return self

    def made_in(self, manual: Manual) -> bool:
        """Return whether a version of the manual contains it."""
        return MANUALS.index(self.since) <= MANUALS.index(manual) <= MANUALS.index(self.until)
