"""Rules of heat: temperatures, latent heat, conduction by classes of pairs, melting and freezing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from eos_ref.model.parameters import Thermal
from lammps_cases.scene.rules.pairs import LINT_MEAN
from lammps_cases.scene.rules.rule import Evaluated, Rule, pair_rule, rules_of


def _of_types(at: Evaluated, value: Callable[[Thermal], Any]) -> Any:
    assert at.sim.model.thermal is not None
    return at.evaluator.of_type(value(p) for p in at.sim.model.thermal)


def _excess_n(at: Evaluated) -> Any:
    """Return the energies per mass beyond those at which particles freeze, (n,); NaN where they do not."""
    freezing_n = _of_types(at, lambda p: np.nan if p.T_freeze is None else p.T_freeze * p.specific_heat)
    return at.evaluator.specific_energy(at.sim.evaluated.energy_n) - freezing_n


def _latent_n(at: Evaluated) -> Any:
    return _of_types(at, lambda p: p.latent_heat)


def _on_plateau(at: Evaluated) -> Any:
    return (_excess_n(at) > 0) & (_excess_n(at) < _latent_n(at))


def _above(at: Evaluated) -> Any:
    return (_excess_n(at) >= _latent_n(at)) & (_latent_n(at) > 0)


def _warmer(at: Evaluated) -> Any:
    kappa_n = at.evaluator.conduction()
    return at.differs_p(at.sim.fields["temperature"]) & (kappa_n[at.i] + kappa_n[at.j] > 0)


def _means(at: Evaluated, harmonic: bool) -> Any:
    means = at.sim.model.pair.harmonic_means == harmonic
    return _warmer(at) & at.differs_p(at.evaluator.conduction()) & means


def _heat(name: str, sentence: str, which: Any, *faults: str) -> Rule:
    return pair_rule(name, sentence, which, *faults, needs="heatflow")


_thermal = rules_of("temperature")
RULES = (
    _thermal(
        "temperature",
        "The temperature follows from the energy per mass and the specific heat.",
        lambda at: at.sim.fields["temperature"] != 0,
        "formula.lint-temperature-of-the-whole-energy",
    ),
    _thermal(
        "latent-plateau",
        "Between freezing and the latent heat beyond it the temperature stays at Tfreeze.",
        _on_plateau,
        "formula.latent-no-plateau",
    ),
    _thermal(
        "latent-heat",
        "Above melting, the latent heat does not contribute to the temperature.",
        _above,
        "formula.latent-forgotten",
    ),
    _thermal(
        "freezing",
        "Fluid below its freezing temperature becomes solid.",
        lambda at: at.solid_n & ~at.start.solid_n,
        "formula.phase-never",
    ),
    _thermal(
        "melting",
        "A solid above its freezing temperature becomes fluid.",
        lambda at: ~at.solid_n & at.start.solid_n,
        "formula.phase-never",
    ),
    _heat(
        "conduction",
        "Heat flows between fluid particles of different temperature.",
        lambda at: _warmer(at) & at.fluids_p,
        "formula.heat-without-two",
    ),
    _heat(
        "conduction-walls",
        "Heat flows between fluid and solid.",
        lambda at: _warmer(at) & at.mixed_p,
        "formula.heat-not-at-walls",
    ),
    _heat(
        "conduction-solids",
        "Heat flows between solids.",
        lambda at: _warmer(at) & at.solids_p,
        "formula.heat-not-in-solids",
    ),
    _heat(
        "conduction-arithmetic",
        "Different conductivities are averaged arithmetically.",
        lambda at: _means(at, harmonic=False),
        "formula.heat-own-kappa",
    ),
    _heat(
        "conduction-harmonic",
        "With harmonic/means different conductivities are averaged harmonically.",
        lambda at: _means(at, harmonic=True),
        "formula.heat-own-kappa",
        LINT_MEAN,
    ),
    _heat(
        "conduction-in-steps",
        "Energies follow the heat flow.",
        lambda at: _warmer(at) & (at.step > 0),
        "formula.heat-half-missing",
    ),
)
