"""Commands of click made from the signatures of functions: names, types, defaults and help are written once, there.

A parameter whose annotation holds an `Option` or `Positional` becomes one of the command; a dataclass stands for its
options. A flag is bool, a choice a Literal, what may be repeated has the default () or is a tuple.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import click

from lammps_cases.cli import completion
from lammps_cases.records.options import Positional, gathered, option_of, parameters


def command(
    *others: click.Parameter, cls: type[click.Command] = click.Command
) -> Callable[[Callable[..., int]], click.Command]:
    """Return a decorator that makes a command of a function NAME_command; ``others`` act and are passed to nobody."""

    def made(function: Callable[..., int]) -> click.Command:
        return cls(
            function.__name__.removesuffix("_command").replace("_", "-"),
            params=[*(parameter(each) for each in parameters(function) if option_of(each.annotation)), *others],
            callback=lambda **given: function(**gathered(function, given)),
            help=inspect.getdoc(function),
        )

    return made


def parameter(of: inspect.Parameter) -> click.Parameter:
    """Return the parameter of a command."""
    option, needed = option_of(of.annotation), of.default is of.empty
    assert option is not None, of
    settings, default = option.settings.copy(), None if needed else of.default
    settings = ({} if default in (None, ()) else {"default": default}) | settings
    if name := settings.pop("complete", None):
        settings["shell_complete"] = getattr(completion, name)
    kind = Path if settings.pop("path", False) else _value(of.annotation)
    many = default == () or get_origin(kind) is tuple
    settings = {"type": _type(kind, of.annotation, settings.pop("like", ""))} | settings
    if isinstance(option, Positional):
        return click.Argument([of.name], nargs=-1 if many else 1, required=needed, **settings)
    flags = option.flags or (f"--{of.name.replace('_', '-')}",)
    shown = default not in (None, "", ()) and kind is not bool and "[default" not in option.text
    settings = {"multiple": many, "is_flag": kind is bool or None, "show_default": shown} | settings
    return click.Option([*flags, of.name], required=needed, help=option.text, **settings)


def _value(annotation: Any) -> Any:
    """Return the type of a value, of several the first."""
    while get_origin(annotation) in (Annotated, Union, UnionType):
        annotation = get_args(annotation)[0]
    return annotation


class ChoiceOrLike(click.Choice[str]):
    """A choice, or whatever a pattern describes."""

    def __init__(self, choices: tuple[str, ...], pattern: str) -> None:
        super().__init__(choices)
        self.pattern = pattern

    def convert(self, value: Any, param: click.Parameter | None, context: click.Context | None) -> Any:
        """Return the value."""
        return value if re.fullmatch(self.pattern, value) else super().convert(value, param, context)


def _type(kind: Any, annotation: Any, pattern: str) -> Any:
    """Return click's type of a value: a choice, a range, a path, or that of Python."""
    if get_origin(kind) is tuple:
        return _type(get_args(kind)[0], annotation, pattern)
    if get_origin(kind) is Literal:
        return ChoiceOrLike(get_args(kind), pattern)
    if bounds := _bounds(annotation):
        return (click.IntRange if kind is int else click.FloatRange)(*bounds)
    return click.Path(path_type=Path) if kind is Path else kind


def _bounds(annotation: Any) -> tuple[Any, Any] | None:
    """Return the least and the largest value by the metadata of an annotation."""
    own = getattr(annotation, "__metadata__", ())
    found = next((each for each in own if hasattr(each, "ge")), None)
    inner = (bounds for part in get_args(annotation) if (bounds := _bounds(part)))
    return (found.ge, getattr(found, "le", None)) if found else next(inner, None)
