"""Rules of the equations of state and of what a type is: particles whose pressure follows from each law."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from eos_ref.eos.table import EOS
from lammps_cases.scene.rules.rule import Evaluated, Rule


def _of(test: Callable[[EOS], bool]) -> Callable[[Evaluated], Any]:
    """Return the particles whose law passes a test."""
    return lambda at: at.evaluator.of_type(test(law) for law in at.sim.model.eos)


def _law(name: str, sentence: str, test: Callable[[EOS], bool], *faults: str) -> Rule:
    return Rule(name, sentence, _of(test), needs=("pressure",), faults=faults, dimensions=())


def _density_over_rho0(at: Evaluated) -> Any:
    """Return the densities less those at which the law alone has no pressure; NaN for a gas, which has none."""
    rho0_n = at.evaluator.of_type(np.nan if law.needs_energy else law.rho0 for law in at.sim.model.eos)
    return at.rho_n - rho0_n


def _several_laws(at: Evaluated) -> Any:
    types = np.unique(at.evaluator.type_n)
    laws = {at.sim.model.eos[int(t)] for t in types}
    return np.full(at.evaluator.n, len(laws) > 1)


RULES = (
    _law(
        "law-linear",
        "The pressure is linear in the density.",
        lambda law: law.style == "linear",
        "formula.linear-of-rho",
    ),
    _law(
        "law-cubic",
        "The pressure has a cubic term, A3 > 0.",
        lambda law: law.style == "cubic" and (law.parameter or 0) > 0,
        "formula.cubic-of-square",
    ),
    _law(
        "law-cubic-negative",
        "The pressure has a cubic term, A3 < 0.",
        lambda law: law.style == "cubic" and (law.parameter or 0) < 0,
        "formula.cubic-of-square",
    ),
    _law(
        "law-tait-water",
        "The pressure follows Tait's law with the exponent 7.",
        lambda law: law.style == "tait/water",
        "formula.water-of-six",
    ),
    _law(
        "law-tait-general",
        "The pressure follows Tait's law with another exponent, not 1.",
        lambda law: law.style == "tait/general" and law.exponent not in (1.0, 7.0),
        "formula.tait-not-over-gamma",
    ),
    _law(
        "law-ideal-gas",
        "The pressure is that of an ideal gas, of density and energy.",
        lambda law: law.needs_energy,
        "formula.gas-without-rho",
    ),
    _law(
        "background",
        "A background pressure is added.",
        lambda law: law.background != 0,
        "formula.background-dropped",
    ),
    Rule(
        "below-rho0",
        "The density is below that of equilibrium, and the law's pressure negative.",
        lambda at: _density_over_rho0(at) < 0,
        needs=("pressure",),
        faults=("formula.tension-cut-off",),
        dimensions=(),
    ),
    Rule(
        "above-rho0",
        "The density is above that of equilibrium, and the law's pressure positive.",
        lambda at: _density_over_rho0(at) > 0,
        needs=("pressure",),
        faults=("formula.compression-cut-off",),
        dimensions=(),
    ),
    Rule(
        "rho0",
        "The equilibrium density of the law is not its default, 1.",
        lambda at: at.evaluator.of_type(law.rho0 != 1 and not law.needs_energy for law in at.sim.model.eos),
        needs=("pressure",),
        faults=("formula.rho0-of-one",),
        dimensions=(),
    ),
    Rule(
        "sound-speed",
        "The speed of sound of the law is not its default, 1.",
        lambda at: at.evaluator.of_type(law.cs != 1 and not law.needs_energy for law in at.sim.model.eos),
        needs=("pressure",),
        faults=("formula.cs-of-one",),
        dimensions=(),
    ),
    Rule(
        "laws-by-type",
        "Types have laws of their own.",
        _several_laws,
        needs=("pressure",),
        faults=("formula.lint-types-exchanged", "formula.law-of-first-type"),
        dimensions=(),
    ),
)
