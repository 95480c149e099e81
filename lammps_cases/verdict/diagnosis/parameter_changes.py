"""Changes of what a deck gives: laws, parameters of types, keywords of fix rheo and of pair_style rheo."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from eos_ref.model.parameters import Model
from lammps_cases.verdict.diagnosis.changes import Change, with_model
from lammps_cases.verdict.diagnosis.law_changes import law_changes


def type_changes(types: int) -> Iterator[Change]:
    """Yield laws of another form, and parameters of another type."""
    for words, law in law_changes(types):
        yield Change(
            words,
            "the laws",
            with_model(lambda model, law=law: replace(model, eos=law(model.eos))),  # type: ignore[misc]
        )
    sources: list[tuple[str, Callable[[Any, int], Any]]] = []
    if types > 1:
        sources += [
            (f"that of type {k + 1} for every type", lambda values, t, k=k: values[k])  # type: ignore[misc]
            for k in range(types)
        ]
        sources.append(("that of the next type", lambda values, t: values[(t + 1) % len(values)]))
        sources.append(("that of the previous type", lambda values, t: values[t - 1]))
    for words, take in sources:
        for name, change in _PARAMETERS.items():
            yield Change(
                f"{name} were {words}",
                f"{name} by type",
                with_model(lambda model, change=change, take=take: change(model, take)),  # type: ignore[misc]
            )


Take = Callable[[Any, int], Any]


def _taken(values: Any, take: Take) -> tuple[Any, ...]:
    return tuple(take(tuple(values), t) for t in range(len(values)))


def _thermal(name: str) -> Callable[[Model, Take], Model]:
    def change(model: Model, take: Take) -> Model:
        if model.thermal is None:
            return model
        taken = _taken([getattr(p, name) for p in model.thermal], take)
        return replace(model, thermal=tuple(replace(p, **{name: v}) for p, v in zip(model.thermal, taken, strict=True)))

    return change


_PARAMETERS: dict[str, Callable[[Model, Take], Model]] = {
    "the mass in all sums": lambda model, take: replace(model, mass_t=_taken(model.mass_t, take)),
    "the viscosity": lambda model, take: replace(model, viscosity=_taken(model.viscosity, take)),
    "the equilibrium density of fix rheo": lambda model, take: replace(
        model, fix=replace(model.fix, rho0=_taken(model.rho0, take))
    ),
    "the speed of sound of fix rheo": lambda model, take: replace(
        model, fix=replace(model.fix, cs=_taken(model.cs, take))
    ),
    "the conductivity": _thermal("conductivity"),
    "the specific heat": _thermal("specific_heat"),
    "the latent heat": _thermal("latent_heat"),
    "the freezing temperature": _thermal("T_freeze"),
}


def _pair(**change: Any) -> Callable[[Model], Model]:
    return lambda model: replace(model, pair=replace(model.pair, **change))


def _fix(**change: Any) -> Callable[[Model], Model]:
    return lambda model: replace(model, fix=replace(model.fix, **change))


def _shift(**change: Any) -> Callable[[Model], Model]:
    def changed(model: Model) -> Model:
        if model.fix.shift is None:
            return model
        return replace(model, fix=replace(model.fix, shift=replace(model.fix.shift, **change)))

    return changed


KEYWORDS: dict[str, Callable[[Model], Model]] = {
    "artificial/visc were ignored": _pair(artificial_viscosity=0.0),
    "rho/damp were ignored": _pair(rho_damp=0.0),
    "self/mass were ignored": _fix(self_mass=False),
    "self/mass were given": _fix(self_mass=True),
    "zmin were 0": _fix(zmin=0),
    "interface/reconstruct were ignored in sums": _fix(interface_reconstruct=False),
    "exclude/type were ignored": _shift(exclude_types=()),
    "scale/cross/type were ignored": _shift(scale_cross_type=None),
    "the kernel were quintic": _fix(kernel="quintic"),
    "the kernel were RK1": _fix(kernel="RK1"),
    "the kernel were RK2": _fix(kernel="RK2"),
}
