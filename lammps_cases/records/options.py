"""The options of a user, declared once: in the signature of a function, or in dataclasses that its signature names.

The command line (`lammps_cases.cli.commands`) and the Python functions (`flat`) are both made from these declarations.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

R = TypeVar("R")


class Option:
    """How a parameter is given on the command line, in the metadata of its annotation.

    Parameters
    ----------
    text : its purpose
    flags : its spellings; by default --NAME
    settings : of ``click.Option``, beyond type and default; ``complete`` names what the shell completes
    """

    def __init__(self, text: str = "", *flags: str, **settings: Any) -> None:
        self.text, self.flags, self.settings = text, flags, settings

    def __repr__(self) -> str:
        return repr(self.text)


class Positional(Option):
    """A parameter that is given by its place."""


def option_of(annotation: Any) -> Option | None:
    """Return the option in an annotation."""
    found = (each for each in get_args(annotation)[1:] if isinstance(each, Option))
    return next(found, None) if get_origin(annotation) is Annotated else None


def parameters(function: Callable[..., Any]) -> list[inspect.Parameter]:
    """List the parameters of a function, a dataclass of options replaced by its options.

    A parameter whose default is made when needed has the default None.
    """
    found = list[inspect.Parameter]()
    hints = get_type_hints(function, include_extras=True)
    for each in inspect.signature(function).parameters.values():
        if not is_dataclass(hints[each.name]):
            found.append(each.replace(annotation=hints[each.name]))
        for name, (of, annotation) in _options(hints[each.name]).items():
            default = None if of.default is MISSING else of.default
            kind = each.KEYWORD_ONLY if of.kw_only else each.kind
            found.append(inspect.Parameter(name, kind, default=default, annotation=annotation))
    return found


def gathered(function: Callable[..., Any], given: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of a function, its dataclasses made from the values of their options."""
    arguments = dict(given)
    for each, hint in get_type_hints(function).items():
        if is_dataclass(hint) and isinstance(hint, type) and each != "return":
            own = {name: (of, arguments.pop(name)) for name, (of, _) in _options(hint).items() if name in arguments}
            made = {name: value for name, (of, value) in own.items() if of.default is not MISSING or value is not None}
            arguments[each] = getattr(hint, "of", hint)(**made)
    return arguments


def _options(hint: Any) -> dict[str, tuple[Field[Any], Any]]:
    if not is_dataclass(hint):
        return {}
    hints = get_type_hints(hint, include_extras=True)
    return {of.name: (of, hints[of.name]) for of in fields(hint) if option_of(hints[of.name])}


def flat(function: Callable[..., R]) -> Callable[..., R]:
    """Return a function that takes the options of dataclasses as its own arguments, and documents them."""

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> R:
        return function(**gathered(function, signature.bind(*args, **kwargs).arguments))

    own = sorted(parameters(function), key=lambda each: each.kind)  # those by name last
    signature = inspect.Signature(own, return_annotation=get_type_hints(function)["return"])
    described = [f"{each.name} :\n    {option.text}" for each in own if (option := option_of(each.annotation))]
    call.__doc__ = (inspect.getdoc(function) or "").replace("(options)", "\n".join(described))
    call.__annotations__ = {each.name: each.annotation for each in own} | {"return": signature.return_annotation}
    types = get_type_hints(call)  # for people: without options and rules
    shown = [each.replace(annotation=types[each.name]) for each in own]
    call.__signature__ = signature.replace(parameters=shown)  # type: ignore[attr-defined]
    return call
