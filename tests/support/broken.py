"""Functions made to fail: every public one of some rooms, found in the modules."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import sys
from collections.abc import Callable, Iterator
from functools import cached_property
from types import CodeType, FunctionType

import pytest


def public(*rooms: str) -> dict[str, FunctionType]:
    """Return all public functions, methods and properties of modules, and of those in packages, by their names."""
    found: dict[str, FunctionType] = {}
    for room in rooms:
        below = pkgutil.iter_modules(getattr(importlib.import_module(room), "__path__", ()), f"{room}.")
        for module in (room, *(each.name for each in below)):
            found |= {f"{module.removeprefix('lammps_cases.')}.{name}": of for name, of in _functions(module)}
    return found


def _functions(module: str) -> Iterator[tuple[str, FunctionType]]:
    for name, value in vars(importlib.import_module(module)).items():
        if getattr(value, "__module__", "") != module or name.startswith("_"):
            continue
        members = vars(value).items() if inspect.isclass(value) else [("", value)]
        for member, of in members:
            plain = of.fget if isinstance(of, property) else of.func if isinstance(of, cached_property) else of
            if isinstance(plain, FunctionType) and not member.startswith("_"):
                yield f"{name}.{member}".rstrip("."), plain


def _fails(*_: object, **__: object) -> None:
    raise RuntimeError("planted here")


def plant(function: FunctionType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a function fail wherever it is referenced."""
    code = _fails.__code__.replace(co_freevars=function.__code__.co_freevars, co_filename=function.__code__.co_filename)
    monkeypatch.setattr(function, "__code__", code)


def called(act: Callable[[], object]) -> set[CodeType]:
    """Return the code of all functions that a callable calls."""
    seen = set[CodeType]()
    before = sys.getprofile()
    sys.setprofile(lambda frame, event, _: seen.add(frame.f_code) if event == "call" else None)
    try:
        act()
    finally:
        sys.setprofile(before)
    return seen
