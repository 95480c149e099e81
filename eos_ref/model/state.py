"""The state of the particles, which a time step changes, and the results of an evaluation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.errors import InputError
from eos_ref.model.box import BoolArray, Box
from eos_ref.model.parameters import IntArray, Model


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

    And virials (n, d, d), if required: of each particle, and for every particle that of all.
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
    """Gradients of one evaluation; None if not required. G[a, b] is d v_a / d x_b."""

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
    try:
        _check_shapes(model.dimension, box, state)
        _check_types(model, state)
        _check_values(model, state)
        _check_positions(box, state)
    except InputError as error:
        raise InputError(error.what, error.rule, error.found, where) from None


def _check_shapes(d: int, box: Box, state: State) -> None:
    """Check that there are particles, and that all arrays are of their number, and finite."""
    n = len(state.x_nc)
    if n == 0:
        raise InputError("particles", "must be at least one", n)
    if len(box.low_c) != d:
        raise InputError("box", f"needs {d} axes", len(box.low_c))
    names = ("positions", "velocities", "density", "type", "solid", "energy", "mass")
    shapes = ((n, d), (n, d), (n,), (n,), (n,), (n,), (n,))
    for what, values, shape in zip(names, vars(state).values(), shapes, strict=True):
        if values is None and what in ("energy", "mass"):
            continue
        if np.shape(values) != shape:
            raise InputError(what, f"must have the shape {shape}", np.shape(values))
        finite = np.isfinite(np.asarray(values, float)).reshape(n, -1).all(axis=1)
        if not finite.all():
            raise InputError(what, f"must be finite, but is not for particle {int(np.argmin(finite)) + 1}")


def _check_types(model: Model, state: State) -> None:
    kinds = (("type", state.type_n, "iu", "whole numbers"), ("solid", state.solid_n, "b", "flags"))
    for what, values, kind, rule in kinds:
        if values.dtype.kind not in kind:
            raise InputError(what, f"must be {rule}", str(values.dtype))
    low, high = int(state.type_n.min()), int(state.type_n.max())
    if low < 1 or high > len(model.mass_t):
        raise InputError("type", f"must lie within 1 to {len(model.mass_t)}", low if low < 1 else high)


def _check_values(model: Model, state: State) -> None:
    """Check energies, densities and masses."""
    if model.thermal is not None and state.energy_n is None:
        raise InputError("energy", "must be given for every particle of a thermal model")
    if state.energy_n is not None:
        gas_n = np.array([law.needs_energy for law in model.eos])[state.type_n - 1]
        if (bad_n := gas_n & (state.energy_n < 0)).any():
            k = int(np.argmax(bad_n))
            raise InputError("energy", f"of gas particle {k + 1} must not be negative", float(state.energy_n[k]))
    for what, values_n in (("density", None if model.fix.rho_sum else state.rho_n), ("mass", state.mass_n)):
        if values_n is not None and not (values_n > 0).all():
            k = int(np.argmin(values_n > 0))
            raise InputError(what, f"must be positive, but is not for particle {k + 1}", float(values_n[k]))


def _check_positions(box: Box, state: State) -> None:
    """Check that particles lie in the box, each on a spot of its own."""
    if (outside := box.outside(state.x_nc)).any():
        k = int(np.argmax(outside))
        raise InputError("position", f"of particle {k + 1} must lie in the box", tuple(state.x_nc[k].tolist()))
    low_c, high_c = np.array(box.low_c), np.array(box.high_c)
    wrapped_nc = np.where(np.array(box.periodic) & (state.x_nc == high_c), low_c, state.x_nc)  # one spot, two names
    unique, first = np.unique(wrapped_nc, axis=0, return_index=True)
    if len(unique) < len(state.x_nc):
        k = int(np.setdiff1d(np.arange(len(state.x_nc)), first)[0])
        rule = f"of particle {k + 1} must differ from those of all others"
        raise InputError("position", rule, tuple(state.x_nc[k].tolist()))
