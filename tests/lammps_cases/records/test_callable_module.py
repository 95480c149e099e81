"""Packages that are called as the function of their own name."""

from __future__ import annotations

import inspect
import sys
from types import ModuleType

import pytest

from lammps_cases.records.options import CallableModule


@pytest.fixture
def package(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A package `made.up`, called for `made.up.command.up`."""
    package, command = CallableModule("made.up"), ModuleType("made.up.command")
    package.__path__ = []

    def up(n: int, by: int = 1) -> int:
        return n + by

    vars(command)["up"] = up
    for module in (ModuleType("made"), package, command):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return package


def test_package_is_called_as_its_function(package: CallableModule) -> None:
    assert package(2) == 3 and package(2, by=5) == 7
    assert str(inspect.signature(package)) == "(n: 'int', by: 'int' = 1) -> 'int'"


def test_function_is_imported_when_called(package: CallableModule, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["made.up.command"], "up", lambda n: -n)
    assert package(2) == -2
    monkeypatch.delitem(sys.modules, "made.up.command")
    with pytest.raises(ModuleNotFoundError, match=r"made\.up\.command"):
        package(2)
