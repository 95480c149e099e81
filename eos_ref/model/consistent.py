"""A model and a state in consistent numbers: every parameter by the factor of its unit (`eos_ref.model.units`)."""

from __future__ import annotations

from dataclasses import replace

from eos_ref.eos.table import EOS, EOSTable
from eos_ref.model.parameters import Force, Model, Thermal, Viscosity
from eos_ref.model.state import State
from eos_ref.model.units import Units


def consistent_model(model: Model, units: Units) -> Model:
    """Return a model in products of the units of length, mass and time, in which formulas have no factors."""
    if units.consistent:
        return model
    density = units.of("rho")
    return replace(
        model,
        units="lj",
        fix=replace(model.fix, rho0=tuple(rho0 * density for rho0 in model.rho0.tolist())),
        eos=EOSTable(tuple(_law(eos, units) for eos in model.eos)),
        viscosity=tuple(_viscosity(law, units) for law in model.viscosity),
        thermal=model.thermal and tuple(_thermal(of_type, units) for of_type in model.thermal),
        forces=tuple(_force(force, units) for force in model.forces),
    )


def _law(eos: EOS, units: Units) -> EOS:
    parameter = eos.parameter
    if parameter is not None and eos.law.parameter == "A3":
        parameter *= units.of("A3")
    background = eos.background * units.of("pressure")
    return replace(eos, rho0=eos.rho0 * units.of("rho"), parameter=parameter, background=background)


def _viscosity(law: Viscosity, units: Units) -> Viscosity:
    factor = units.of("viscosity")  # K is a viscosity times a power of time
    return replace(law, eta=law.eta * factor, K=law.K * factor)


def _thermal(of_type: Thermal, units: Units) -> Thermal:
    return replace(
        of_type,
        conductivity=of_type.conductivity * units.of("conductivity"),
        specific_heat=of_type.specific_heat * units.of("cv"),
        latent_heat=of_type.latent_heat * units.of("latent heat"),
    )


def _force(force: Force, units: Units) -> Force:
    factor = units.of("acceleration" if force.style == "gravity" else "f")
    return replace(force, vector=tuple(None if v is None else v * factor for v in force.vector))


def consistent_state(state: State, units: Units) -> State:
    """Return a state in products of the units of length, mass and time."""
    if units.consistent:
        return state
    energy_n = None if state.energy_n is None else state.energy_n * units.of("energy")
    return replace(state, rho_n=state.rho_n * units.of("rho"), energy_n=energy_n)
