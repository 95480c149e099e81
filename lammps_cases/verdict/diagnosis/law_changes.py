"""Changes of the equations of state that are tried, in words and as functions of a table of laws."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from eos_ref import EOS, EOSTable

Law = Callable[[EOSTable], EOSTable]
OtherType = Callable[[int, int], int]  # of a type, and of how many there are; all from 0
_PARAMETERS = {
    "speed of sound": "cs",
    "equilibrium density": "rho0",
    "parameter": "parameter",
    "background": "background",
}
_POWERS: dict[str, Callable[[float], float]] = {
    "a {} of 1": lambda value: 1.0,
    "the square root of the {}": lambda value: value**0.5,
    "the square of the {}": lambda value: value**2,
    "twice the {}": lambda value: 2 * value,
    "half the {}": lambda value: value / 2,
}
_EXPONENTS: dict[str, Callable[[float], float]] = {
    "one more than it is": lambda value: value + 1,
    "one less than it is": lambda value: value - 1,
    "0": lambda value: 0.0,
    "7": lambda value: 7.0,
    "of the other sign": lambda value: -value,
}


def law_changes(types: int) -> Iterator[tuple[str, Law]]:
    """Yield changes of the laws of all types, in words; some mean nothing for some laws and raise there."""
    if types > 1:
        for k in range(types):
            yield from _of_another(f"type {k + 1}", lambda t, count, k=k: k)  # type: ignore[misc]
        yield from _of_another("the next type", lambda t, count: (t + 1) % count)
        yield from _of_another("the previous type", lambda t, count: (t - 1) % count)
    yield from _of_numbers()
    yield "the background pressure were missing", _each(lambda law: replace(law, background=0.0))
    yield "the background pressure had the other sign", _each(lambda law: replace(law, background=-law.background))
    yield "every law were linear", _each(_linear)
    for words, other in _EXPONENTS.items():
        yield f"the parameter of every law (gamma, A3) were {words}", _each(_with_parameter(other))


def _each(change: Callable[[EOS], EOS]) -> Law:
    return lambda table: EOSTable(tuple(map(change, table.laws)))


def _of_another(words: str, other: OtherType) -> Iterator[tuple[str, Law]]:
    """Yield what a law could have taken from that of another type: a parameter, or all of it."""

    def taken(key: str) -> Law:
        def change(law: EOS, of: EOS) -> EOS:
            return replace(law, **{key: getattr(of, key)}) if key else of

        return lambda table: EOSTable(
            tuple(change(law, table[other(t, len(table)) + 1]) for t, law in enumerate(table.laws))
        )

    for name, key in _PARAMETERS.items():
        yield f"the pressure of every particle used the {name} of {words}", taken(key)
    yield f"the pressure of every particle followed the law of {words}", taken("")


def _of_numbers() -> Iterator[tuple[str, Law]]:
    """Yield other speeds of sound and equilibrium densities."""

    def powered(key: str, number: Callable[[float], float]) -> Law:
        def change(law: EOS) -> EOS:
            changed: Any = {key: number(getattr(law, key))}
            return replace(law, **changed)

        return _each(change)

    for name in ("speed of sound", "equilibrium density"):
        for words, number in _POWERS.items():
            yield f"the pressure of every particle used {words.format(name)}", powered(_PARAMETERS[name], number)


def _linear(law: EOS) -> EOS:
    return law if law.needs_energy else EOS("linear", law.rho0, law.cs, None, law.background)


def _with_parameter(other: Callable[[float], float]) -> Callable[[EOS], EOS]:
    return lambda law: law if law.parameter is None else replace(law, parameter=other(law.parameter))
