r"""The particle model that a deck defines: everything fixed before the first step, the box, and the state.

One `Model` holds what fix rheo, pair_style rheo, fix rheo/viscosity, fix rheo/pressure, fix rheo/thermal and the
external forces say; one `State` what a time step changes. Quantities are in the units of the model's system, and turned
into consistent ones before anything is computed (`eos_ref.model.consistent`).
"""

from __future__ import annotations

import math
from collections.abc import Sized
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from eos_ref.eos.table import EOSTable, FloatArray
from eos_ref.errors import InputError
from eos_ref.kernels.kernel import Kernel
from eos_ref.kernels.styles import KERNELS
from eos_ref.model.units import UNITS, UnitStyle
from eos_ref.syntax.fixes import FixRheo
from eos_ref.syntax.ranges import type_range

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.integer[Any]]


TILTED = ((0, 1), (0, 2), (1, 2))  # xy, xz and yz: along which axis the edge of which leans
Remap = Literal["x", "v", "none"]  # what fix deform changes with the box
SMALLEST = float(np.finfo(float).tiny)  # the least number with all its digits


def _check_positive(what: str, number: float) -> None:
    if not (math.isfinite(number) and number > 0):
        raise InputError(what, "must be positive", number)


def _check_not_negative(what: str, number: float) -> None:
    if not (math.isfinite(number) and number >= 0):
        raise InputError(what, "must be finite and not negative", number)


@dataclass(frozen=True)
class Box:
    """A box with the edges (lx, 0, 0), (xy, ly, 0) and (xz, yz, lz); in 2D the third axis is without meaning.

    Attributes
    ----------
    low_c, high_c : one corner, and that of the upright box, in which the edges lean by nothing
    periodic : one flag per axis
    tilt : by how much the edges lean, xy or xy, xz, yz, between periodic axes alone; empty: the box is rectangular,
        and positions in it never go to fractions of its edges
    """

    low_c: tuple[float, ...]
    high_c: tuple[float, ...]
    periodic: tuple[bool, ...]
    tilt: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not len(self.low_c) == len(self.high_c) == len(self.periodic) in (2, 3):
            raise InputError("box", "needs low, high and periodic for 2 or 3 axes", len(self.low_c))
        for low, high in zip(self.low_c, self.high_c, strict=True):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise InputError("box", "needs finite edges with low < high", (low, high))
        if self.tilt and len(self.tilt) != (1 if len(self.low_c) == 2 else 3):
            raise InputError("tilt of the box", "must be xy in 2D, xy, xz and yz in 3D", self.tilt)
        for tilt, (one, other) in zip(self.tilt, TILTED, strict=False):
            if not math.isfinite(tilt) or (tilt and not (self.periodic[one] and self.periodic[other])):
                raise InputError("tilt of the box", "must be finite, and 0 but between periodic axes", self.tilt)

    @property
    def edge_c(self) -> tuple[float, ...]:
        """Return the edge lengths, of the upright box."""
        return tuple(high - low for low, high in zip(self.low_c, self.high_c, strict=True))

    @property
    def tilted(self) -> bool:
        """Return whether an edge leans."""
        return any(self.tilt)

    @property
    def cell_cc(self) -> FloatArray:
        """Return the edges as rows."""
        cell_cc = np.diag(self.edge_c)
        for tilt, (to, of) in zip(self.tilt, TILTED, strict=False):
            cell_cc[of, to] = tilt
        return cell_cc

    def upright(self, distance_nc: FloatArray) -> FloatArray:
        """Return distances, (n, d), without what they lean: in a rectangular box the same."""
        if not self.tilted:
            return distance_nc
        upright_nc, cell_cc = np.array(distance_nc, float), self.cell_cc
        for axis in reversed(range(1, len(self.edge_c))):
            upright_nc[:, :axis] -= (upright_nc[:, axis] / self.edge_c[axis])[:, None] * cell_cc[axis, :axis]
        return upright_nc

    def images(self, x_nc: FloatArray) -> FloatArray:
        """Return by how many edges positions, (n, d), lie outside, in whole numbers; 0 along open axes."""
        fraction_nc = self.upright(x_nc - np.array(self.low_c)) / self.edge_c
        return np.where(self.periodic, np.floor(fraction_nc), 0.0)

    def periods(self, distance_nc: FloatArray) -> FloatArray:
        """Return the whole numbers of edges nearest to distances, (n, d); 0 along open axes."""
        return np.where(self.periodic, np.round(self.upright(distance_nc) / self.edge_c), 0.0)

    def shift(self, image_nc: FloatArray) -> FloatArray:
        """Return whole numbers of edges as distances, (n, d)."""
        return np.asarray(image_nc @ self.cell_cc if self.tilted else image_nc * np.array(self.edge_c))

    def outside(self, x_nc: FloatArray) -> BoolArray:
        """Return which positions, (n, d), lie beyond a face, (n,)."""
        low_c, high_c = np.array(self.low_c), np.array(self.high_c)
        upright_nc = low_c + self.upright(x_nc - low_c) if self.tilted else x_nc
        return np.asarray(((upright_nc < low_c) | (upright_nc > high_c)).any(axis=1))

    def rounding(self, reach: float) -> FloatArray:
        r"""Return how far the same position may lie in two codes, (d,), up to a reach outside; 0 if rectangular.

        A position in a tilted box goes to fractions of its edges and back, :math:`\mathbf x=\mathbf x_0+H(H^{-1}
        (\mathbf x-\mathbf x_0))`, whenever neighbour lists are built. Roundings of the absolute terms of both products:
        the difference 1, an element of the inverse 5, its products and sums 3, the number of an image 1, the products
        and sums back 3, the corner 1.
        """
        if not self.tilt:
            return np.zeros(len(self.low_c))
        cell_cc = np.abs(self.cell_cc)
        lean_cc = cell_cc / np.array(self.edge_c)[:, None]  # of H = E (1 + N), N being triangular: 1 + |N|
        inverse_cc = np.linalg.inv(2 * np.eye(len(lean_cc)) - lean_cc)  # 1 + |N| + |N|^2
        terms_c = np.abs(self.low_c) + (cell_cc.sum(axis=0) + reach) @ inverse_cc @ lean_cc
        return np.asarray(14 * 2.0**-53 * terms_c)


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
class Deform:
    """A box whose edges grow and lean at engineering strain rates (fix deform, style erate).

    Attributes
    ----------
    rate_c : of the edges, one per axis
    remap : positions keep their fractions of the edges (x), or stay where they are (v, none); with v a particle that
        crosses a periodic boundary takes on the velocity of its image, which moves with the box
    shear : of the tilts, xy or xy, xz, yz; empty: none
    """

    rate_c: tuple[float, ...]
    remap: Remap = "x"
    shear: tuple[float, ...] = ()

    @property
    def changes(self) -> bool:
        """Return whether the box changes at all."""
        return any((*self.rate_c, *self.shear))

    def box(self, first: Box, time: float) -> Box:
        r"""Return the box some time after the run began in another one.

        :math:`L(t)=L_0(1+\dot\varepsilon t)`, the middle of every edge staying where it is, and
        :math:`T(t)=T_0+L_0\dot\gamma t`, :math:`L_0` being that of the axis along which the edge that leans goes.
        """
        growth = np.array(self.rate_c) * (0.5 * time) * np.array(first.edge_c)
        low_c, high_c = np.array(first.low_c) - growth, np.array(first.high_c) + growth
        tilt = first.tilt
        if self.shear:
            edges = [first.edge_c[of] for (_, of), _ in zip(TILTED, self.shear, strict=False)]
            lean = np.array(self.shear) * time * np.array(edges)
            tilt = tuple((np.array(first.tilt or np.zeros(len(lean))) + lean).tolist())
        return replace(first, low_c=tuple(low_c.tolist()), high_c=tuple(high_c.tolist()), tilt=tilt)

    def image_velocity(self, first: Box) -> FloatArray | None:
        """Return how fast images move that are one edge away, (d, d), by rows: with remap v, else not at all."""
        if self.remap != "v":
            return None
        velocity_cc = np.diag(np.array(self.rate_c) * np.array(first.edge_c))
        for rate, (to, of) in zip(self.shear, TILTED, strict=False):
            velocity_cc[of, to] = rate * first.edge_c[of]
        return velocity_cc


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


@dataclass
class State:
    """State of the particles, which a step changes: one row per particle.

    Attributes
    ----------
    x_nc, v_nc : (n, d) positions and velocities
    rho_n : (n,) densities; overwritten by the sum if the model sums them
    type_n : (n,) types, 1 to N
    solid_n : (n,) whether a particle is solid
    energy_n : (n,) energy of the particle (not per mass), with a thermal model
    mass_n : (n,) masses of the particles, if they have masses of their own; None: those of their types
    """

    x_nc: Any  # float arrays, or `eos_ref.numbers.rounded` ones
    v_nc: Any
    rho_n: Any
    type_n: IntArray
    solid_n: BoolArray
    energy_n: Any = None
    mass_n: FloatArray | None = None

    def copy(self) -> State:
        """Return a state that shares no array with this one."""
        return replace(self, **{name: array.copy() for name, array in vars(self).items() if array is not None})


@dataclass(frozen=True)
class PairTerms:
    """Sums over the pairs: force (n, d), its pressure and artificial part, density diffusion (n,), heat flow (n,).

    And virials (n, d, d), where they are asked for: of each particle, and for every particle that of all.
    """

    force_nc: Any
    pressure_force_nc: Any
    drho_n: Any
    heat_n: Any
    virial_ncc: Any = None
    whole_ncc: Any = None


@dataclass(frozen=True)
class Surface:
    """Result of surface detection: 0 bulk, 1 surface, 2 splash; distance; normal; divergence of positions."""

    class_n: Any = None
    r_n: Any = None
    normal_nc: Any = None
    divr_n: Any = None


@dataclass
class Gradients:
    """Gradients of one evaluation; None where nothing asked for them. G[a, b] is d v_a / d x_b."""

    v_ncc: Any = None
    rho_nc: Any = None
    energy_nc: Any = None


def masses(model: Model, state: State) -> FloatArray:
    """Return the mass of every particle, (n,): its own, or that of its type."""
    return model.mass[state.type_n - 1] if state.mass_n is None else state.mass_n


def check_state(model: Model, box: Box, state: State, where: str = "") -> None:
    """Check a state against its model, once, at the edge.

    With a negative energy the square of a gas' speed of sound is negative; with 0 the gas is at absolute zero. To
    conduction, melting and freezing only differences of energies matter: those of other laws are counted from any zero.

    Raises
    ------
    InputError
        Arrays of the wrong shape, values that are not finite, particles outside the box or on the same spot, densities
        or masses that are not positive, energies missing for a thermal model or negative for a gas.
    """
    n, d = len(state.x_nc), model.dimension
    if n == 0:
        raise InputError("particles", "must be at least one", n, where)
    if len(box.low_c) != d:
        raise InputError("box", f"needs {d} axes", len(box.low_c), where)
    names = ("positions", "velocities", "density", "type", "solid", "energy", "mass")
    shapes = ((n, d), (n, d), (n,), (n,), (n,), (n,), (n,))
    for what, values, shape in zip(names, vars(state).values(), shapes, strict=True):
        if values is None and what in ("energy", "mass"):
            continue
        if np.shape(values) != shape:
            raise InputError(what, f"must have the shape {shape}", np.shape(values), where)
        finite = np.isfinite(np.asarray(values, float)).reshape(n, -1).all(axis=1)
        if not finite.all():
            raise InputError(what, f"must be finite, but is not for particle {int(np.argmin(finite)) + 1}", where=where)
    kinds = (("type", state.type_n, "iu", "whole numbers"), ("solid", state.solid_n, "b", "flags"))
    for what, values, kind, rule in kinds:
        if values.dtype.kind not in kind:
            raise InputError(what, f"must be {rule}", str(values.dtype), where)
    low, high = int(state.type_n.min()), int(state.type_n.max())
    if low < 1 or high > len(model.mass_t):
        raise InputError("type", f"must lie within 1 to {len(model.mass_t)}", low if low < 1 else high, where)
    if model.thermal is not None and state.energy_n is None:
        raise InputError("energy", "must be given for every particle of a thermal model", where=where)
    if state.energy_n is not None:
        gas_n = np.array([law.needs_energy for law in model.eos])[state.type_n - 1]
        if (bad_n := gas_n & (state.energy_n < 0)).any():
            k = int(np.argmax(bad_n))
            raise InputError("energy", f"of gas particle {k + 1} must not be negative", float(state.energy_n[k]), where)
    if not model.fix.rho_sum and not (state.rho_n > 0).all():
        k = int(np.argmin(state.rho_n > 0))
        raise InputError("density", f"must be positive, but is not for particle {k + 1}", float(state.rho_n[k]), where)
    if state.mass_n is not None and not (state.mass_n > 0).all():
        k = int(np.argmin(state.mass_n > 0))
        raise InputError("mass", f"must be positive, but is not for particle {k + 1}", float(state.mass_n[k]), where)
    if (outside := box.outside(state.x_nc)).any():
        k = int(np.argmax(outside))
        raise InputError("position", f"of particle {k + 1} must lie in the box", tuple(state.x_nc[k].tolist()), where)
    low_c, high_c = np.array(box.low_c), np.array(box.high_c)
    wrapped_nc = np.where(np.array(box.periodic) & (state.x_nc == high_c), low_c, state.x_nc)  # one spot, two names
    unique, first = np.unique(wrapped_nc, axis=0, return_index=True)
    if len(unique) < n:
        k = int(np.setdiff1d(np.arange(n), first)[0])
        rule = f"of particle {k + 1} must differ from those of all others"
        raise InputError("position", rule, tuple(state.x_nc[k].tolist()), where)
