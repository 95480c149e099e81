r"""The particle model that a deck defines: everything fixed before the first step.

One `Model` holds what fix rheo, pair_style rheo, fix rheo/viscosity, fix rheo/pressure, fix rheo/thermal and the
external forces say. Quantities are in the units of the model's system, and turned
into consistent ones before anything is computed (`eos_ref.model.consistent`).
"""

from __future__ import annotations

import math
from collections.abc import Sized
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from eos_ref.eos.table import EOSTable, FloatArray
from eos_ref.errors import InputError
from eos_ref.kernels.kernel import Kernel
from eos_ref.kernels.styles import KERNELS
from eos_ref.model.bonds import Elastic
from eos_ref.model.box import BoolArray, Deform
from eos_ref.model.units import UNITS, UnitStyle
from eos_ref.syntax.fixes import FixRheo
from eos_ref.syntax.ranges import type_range

IntArray = npt.NDArray[np.integer[Any]]


SMALLEST = float(np.finfo(float).tiny)  # the least number with all its digits


def _check_positive(what: str, number: float) -> None:
    if not (math.isfinite(number) and number > 0):
        raise InputError(what, "must be positive", number)


def _check_not_negative(what: str, number: float) -> None:
    if not (math.isfinite(number) and number >= 0):
        raise InputError(what, "must be finite and not negative", number)


@dataclass(frozen=True)
class Viscosity:
    r"""Viscosity of one type (fix rheo/viscosity): ``constant`` eta, or ``power`` with eta, gd0, K, n.

    power: :math:`\eta` up to the strain rate :math:`\dot\gamma_0`, beyond it
    :math:`K\dot\gamma^{n-1} + \tau_0/\dot\gamma` with :math:`\tau_0 = \eta\dot\gamma_0 - K\dot\gamma_0^n`.

    With a negative n the stress would fall as the strain rate grows, to 0 and below. n = 0 is a yield stress alone.
    """

    style: Literal["constant", "power"]
    eta: float
    gd0: float = 0.0
    K: float = 0.0
    n: float = 1.0

    def __post_init__(self) -> None:
        for name in ("eta", "gd0", "K", "n"):
            if not math.isfinite(getattr(self, name)):
                raise InputError(f"{name} of rheo/viscosity", "must be a finite number", getattr(self, name))
        for name in ("eta", "gd0", "K", "n"):
            if getattr(self, name) < 0:
                raise InputError(f"{name} of rheo/viscosity", "must not be negative", getattr(self, name))
        if self.style not in ("constant", "power"):
            raise InputError("style of rheo/viscosity", "must be constant or power", self.style)
        if self.style == "power" and self.gd0 == 0:
            raise InputError("gd0 of rheo/viscosity", "must be positive for power", self.gd0)


@dataclass(frozen=True)
class Thermal:
    """Conductivity, specific heat and, optionally, latent heat and freezing temperature of one type."""

    conductivity: float
    specific_heat: float
    latent_heat: float = 0.0
    T_freeze: float | None = None

    def __post_init__(self) -> None:
        _check_not_negative("conductivity", self.conductivity)
        _check_positive("specific/heat", self.specific_heat)
        _check_not_negative("latent/heat", self.latent_heat)
        if self.T_freeze is not None and not math.isfinite(self.T_freeze):
            raise InputError("Tfreeze", "must be a finite number", self.T_freeze)
        if self.latent_heat and self.T_freeze is None:
            raise InputError("latent/heat", "needs a freezing temperature (Tfreeze)")


@dataclass(frozen=True)
class PairRheo:
    """Arguments of pair_style rheo; 0 turns a term off."""

    cut: float
    artificial_viscosity: float = 0.0
    rho_damp: float = 0.0
    harmonic_means: bool = False

    def __post_init__(self) -> None:
        for name in ("artificial_viscosity", "rho_damp"):
            _check_not_negative(f"{name} of pair rheo", getattr(self, name))


@dataclass(frozen=True)
class Force:
    """An external fix on some types (None: all), applied in the order of `Model.forces`.

    ``gravity``: acceleration; ``addforce``: force added; ``setforce``: force set, None leaves a component.
    """

    style: Literal["gravity", "addforce", "setforce"]
    vector: tuple[float | None, ...]
    types: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        if self.style not in ("gravity", "addforce", "setforce"):
            raise InputError("force", "must be one of gravity, addforce, setforce", self.style)
        for component in self.vector:
            if component is None and self.style != "setforce":
                raise InputError(self.style, "needs a number for every axis (None is for setforce)", self.vector)
            if component is not None and not math.isfinite(component):
                raise InputError(self.style, "needs finite components", component)

    def acts_on(self, type_n: IntArray) -> BoolArray:
        """Return which particles it acts on, (n,)."""
        return np.ones(type_n.shape, bool) if self.types is None else np.isin(type_n, self.types)


@dataclass(frozen=True)
class Model:
    """What the commands of a deck define.

    Parameters
    ----------
    dimension : {2, 3}
    fix : FixRheo
        Kernel, cutoff, options, equilibrium densities and speeds of sound.
    mass_t : sequence of float
        Mass per type.
    eos : EOSTable
    pair : PairRheo
    viscosity : sequence of Viscosity, one per type
    thermal : sequence of Thermal or None
    forces : sequence of Force
    deform : Deform or None
    elastic : Elastic or None
        Bonds, and contacts of solids.
    units : {"lj", "si", "real", "metal", "cgs", "micro", "nano"}
        The system that all numbers are measured in.

    Raises
    ------
    InputError
        Options that contradict each other, cutoffs that differ, a list without one value per type.
    """

    dimension: Literal[2, 3]
    fix: FixRheo
    mass_t: tuple[float, ...]
    eos: EOSTable
    pair: PairRheo
    viscosity: tuple[Viscosity, ...]
    thermal: tuple[Thermal, ...] | None = None
    forces: tuple[Force, ...] = ()
    deform: Deform | None = None
    elastic: Elastic | None = None
    units: UnitStyle = "lj"

    def __post_init__(self) -> None:
        if self.dimension not in (2, 3):
            raise InputError("dimension", "must be 2 or 3", self.dimension)
        if self.units not in UNITS:
            raise InputError("units", f"must be one of {', '.join(UNITS)}", self.units)
        if self.dimension == 2 and not UNITS[self.units].consistent:
            raise InputError(
                "units", "must not be real or metal in 2D: pressure and viscosity have no unit there", self.units
            )
        if self.elastic and not UNITS[self.units].consistent:
            raise InputError("units", "must not be real or metal with bonds or contacts", self.units)
        for what, values in (("equation of state", self.eos), ("viscosity", self.viscosity), ("thermal", self.thermal)):
            self._check_count(what, values)
        for mass in self.mass_t:
            _check_positive("mass", mass)
        self._check_kernel()
        self._check_thermal()
        for what, values_t in (("density", self.fix.rho0), ("speed/sound", self.fix.cs)):
            self._check_count(what, values_t)
            for number in values_t or ():
                _check_positive(what, number)
        for t, (rho0, cs) in enumerate(zip(self.rho0.tolist(), self.cs.tolist(), strict=True), 1):
            if not SMALLEST <= rho0 * cs * cs < math.inf:
                rule = f"density times speed/sound squared must be a number with all its digits for type {t}"
                raise InputError("scale of the pressure", rule, rho0 * cs * cs)
        for types in self.fix.shift.exclude_types if self.fix.shift else ():
            type_range(types, len(self.mass_t), "exclude/type")
        for force in self.forces:
            self._check_force(force)
        if self.deform:
            self._check_deform(self.deform)

    def _check_count(self, what: str, values: Sized | None) -> None:
        n = len(self.mass_t)
        if values is not None and len(values) != n:
            raise InputError(what, f"needs one value per atom type ({n})", len(values))

    def _check_kernel(self) -> None:
        fix = self.fix
        if fix.kernel not in KERNELS:
            raise InputError("kernel", f"must be one of {', '.join(KERNELS)}", fix.kernel)
        _check_positive("cut", fix.cut)
        if not 1e-100 <= fix.cut <= 1e100:
            raise InputError("cut", "must lie within 1e-100 and 1e100, beyond which W(0) is 0 or infinite", fix.cut)
        if self.pair.cut != fix.cut:
            raise InputError("cutoff of pair_style rheo", f"must equal that of fix rheo ({fix.cut:g})", self.pair.cut)
        if fix.self_mass and not fix.rho_sum:
            raise InputError("self/mass", "is an argument of rho/sum")

    def _check_thermal(self) -> None:
        if self.fix.thermal != (self.thermal is not None):
            rule = "needs fix rheo/thermal" if self.fix.thermal else "needs the keyword thermal of fix rheo"
            raise InputError("thermal", rule)
        for law in self.eos:
            if law.needs_energy and not self.fix.thermal:
                raise InputError(law.style, "needs particles with energy (keyword thermal)")

    def _check_force(self, force: Force) -> None:
        if len(force.vector) != self.dimension:
            raise InputError(force.style, f"needs {self.dimension} components", len(force.vector))
        for t in force.types or ():
            if not 1 <= t <= len(self.mass_t):
                raise InputError(f"types of {force.style}", f"must lie within 1 to {len(self.mass_t)}", t)

    def _check_deform(self, deform: Deform) -> None:
        if len(deform.rate_c) != self.dimension:
            raise InputError("deform", f"needs {self.dimension} rates", len(deform.rate_c))
        if deform.shear and len(deform.shear) != self.dimension * (self.dimension - 1) // 2:
            raise InputError("deform", "needs rates of xy in 2D, of xy, xz and yz in 3D", deform.shear)
        if not all(map(math.isfinite, (*deform.rate_c, *deform.shear))):
            raise InputError("deform", "needs finite rates", (*deform.rate_c, *deform.shear))
        if deform.remap == "v" and self.fix.shift:
            raise InputError("deform", "with remap v goes without shift, which follows the speed of each image")

    @property
    def cut(self) -> float:
        """Return the support radius of the kernel (length)."""
        return self.fix.cut

    @property
    def h(self) -> float:
        """Return the smoothing length, cut/3 of the quintic spline."""
        return self.fix.cut / self.kernel.support

    @property
    def kernel(self) -> Kernel:
        """Return the kernel of all sums; a reproducing kernel corrects its gradients."""
        return KERNELS[self.fix.kernel].kernel

    @property
    def order(self) -> int:
        """Return the order of the reproducing kernel; -1 for a kernel without correction."""
        return KERNELS[self.fix.kernel].order

    @property
    def weighs_distance(self) -> bool:
        """Return whether support by particles of the same type is weighed by their distance."""
        return self.fix.shift is not None and self.fix.shift.weighs_distance

    @property
    def corrects_gradients(self) -> bool:
        """Return whether gradients are those of a reproducing kernel (RK1, RK2); RK0 has no unique gradient."""
        return self.order >= 1

    @cached_property
    def mass(self) -> FloatArray:
        """Return the mass of every type, indexed by type - 1, as are the following."""
        return np.array(self.mass_t)

    @cached_property
    def rho0(self) -> FloatArray:
        """Return the equilibrium density of every type."""
        return np.array(self.fix.rho0 or (1.0,) * len(self.mass_t))

    @cached_property
    def cs(self) -> FloatArray:
        """Return the speed of sound of every type, given in fix rheo."""
        return np.array(self.fix.cs or (1.0,) * len(self.mass_t))

    @cached_property
    def shifted_t(self) -> BoolArray:
        """Return which types are shifted (exclude/type)."""
        shifted_t = np.ones(len(self.mass_t), bool)
        for types in self.fix.shift.exclude_types if self.fix.shift else ():
            shifted_t[[t - 1 for t in type_range(types, len(self.mass_t))]] = False
        return shifted_t
