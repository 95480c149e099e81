"""Equations of state per atom type: parameters, pressure, inverse, sound speed, domain."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from eos_ref.eos import laws
from eos_ref.errors import InputError
from eos_ref.numbers.elementary import Number

Style = Literal["linear", "cubic", "tait/water", "tait/general", "ideal/gas"]
STYLES: tuple[Style, ...] = get_args(Style)
PARAMETER = {"cubic": "A3", "tait/general": "gamma", "ideal/gas": "gamma", "background": "P_b"}
FloatArray = npt.NDArray[np.float64]


class Interval(NamedTuple):
    """An interval of densities; the ends may be infinite."""

    low: float
    high: float


@dataclass(frozen=True)
class EOS:
    r"""Equation of state of one atom type, as fix rheo/pressure defines it.

    Parameters
    ----------
    style : {"linear", "cubic", "tait/water", "tait/general", "ideal/gas"}
        The law.
    rho0 : float
        Equilibrium density (density), > 0. Default 1, as in fix rheo.
    cs : float
        Speed of sound (velocity), > 0. Default 1. Not used by ideal/gas.
    parameter : float, optional
        :math:`A_3` of cubic (1/density\ :sup:`2`), exponent gamma of tait/general (not 0) or heat capacity
        ratio gamma of ideal/gas (> 1).
    background : float
        Background pressure :math:`P_b` (pressure), added to the law's value. Default 0.

    Raises
    ------
    InputError
        A parameter is missing, superfluous, not a finite number or outside its domain.

    Source: LAMMPS manual, fix rheo/pressure and fix rheo (defaults).
    """

    style: Style
    rho0: float = 1.0
    cs: float = 1.0
    parameter: float | None = None
    background: float = 0.0

    def __post_init__(self) -> None:
        if self.style not in STYLES:
            raise InputError("pressure style", f"must be one of {', '.join(STYLES)}", self.style)
        name = PARAMETER.get(self.style)
        if name is None and self.parameter is not None:
            raise InputError(self.style, "takes no argument", self.parameter)
        if name is not None and self.parameter is None:
            raise InputError(self.style, f"needs the argument {name} (keyword parameter)")
        fields = {"rho0": "rho0", "cs": "cs", "background": "background"}
        for field, what in (fields if name is None else fields | {"parameter": name}).items():
            # Always plain floats: in whole numbers or float32, c*c would overflow or round early.
            object.__setattr__(self, field, _finite(what, getattr(self, field)))
        for what, value in (("rho0", self.rho0), ("cs", self.cs)):
            if value <= 0:
                raise InputError(what, "must be positive", value)
        if self.style == "tait/general" and self.parameter == 0:
            raise InputError("gamma of tait/general", "must not be 0 (the law divides by it)", self.parameter)
        if self.style == "ideal/gas" and self.gamma <= 1:
            raise InputError("gamma of ideal/gas", "must exceed 1 (a heat capacity ratio)", self.parameter)

    @property
    def gamma(self) -> float:
        """Exponent of Tait's law (7 for water) or heat capacity ratio of the ideal gas."""
        return 7.0 if self.style == "tait/water" else float(self.parameter or 0.0)

    @property
    def needs_energy(self) -> bool:
        """Whether the law depends on the internal energy."""
        return self.style == "ideal/gas"

    def evaluate(self, rho: Number, e: Number = None, convert: Any = None) -> Number:
        """Pressure in the number type of ``rho``: numpy arrays and scalars of any float type, or Arb balls.

        ``convert`` turns the parameters into that type (for Arb: ``flint.arb``); numpy's types need none.
        """
        # numpy rounds a Python float to float32 by itself; longdouble needs products of parameters in full.
        of: Any = convert or (np.longdouble if getattr(rho, "dtype", None) == np.longdouble else float)
        rho0, cs, background = of(self.rho0), of(self.cs), of(self.background)
        match self.style:
            case "linear":
                p = laws.linear(rho, rho0, cs)
            case "cubic":
                p = laws.cubic(rho, rho0, cs, of(self.parameter))
            case "tait/water":
                p = laws.tait_water(rho, rho0, cs)
            case "tait/general":
                p = laws.tait_general(rho, rho0, cs, of(self.parameter))
            case _:
                p = laws.ideal_gas(rho, self._energy(e), of(self.parameter))
        return p + background

    def pressure(
        self,
        rho: npt.ArrayLike,
        e: npt.ArrayLike | None = None,
        method: str | None = None,
        tolerance: float | None = None,
    ) -> FloatArray:
        r"""Return the pressure of particles of this type: :math:`P = P_{law}(\rho, e) + P_b`.

        Parameters
        ----------
        rho : array_like, any shape
            Density.
        e : array_like, same shape or scalar, optional
            Internal energy per unit mass; needed by ideal/gas.
        method : str, optional
            Default: the reference's own compiled loops. ``"auto"``: the cheapest method that meets ``tolerance``. Or
            the name of a method that evaluates doubles, as ``eos-ref chart`` lists them
            (`eos_ref.methods.laws.METHODS`).
        tolerance : float, optional
            Of ``"auto"``, which needs it: the largest error allowed, relative to the law's value and the background
            pressure, both taken absolute. The worst error of a method is searched for over the interval that the
            densities span (`eos_ref.methods.worst`).

        Returns
        -------
        ndarray of float64, shape of ``rho`` (a scalar for a scalar)
            By default the error is at most 2 eps (cubic 5) times the sum of the absolute terms; for the power laws
            4 eps times that sum times 1 + \|gamma ln(rho/rho0)\|. NaN where the law is not defined.

        Raises
        ------
        InputError
            No energy for ideal/gas, or energies of another shape; an unknown method, a tolerance without ``"auto"``
            or the reverse, a tolerance that no method meets.

        Examples
        --------
        >>> gas = EOS("tait/general", parameter=1.4)
        >>> print(gas.pressure([0.9, 1.1], method="auto", tolerance=1e-9).round(6))
        [-0.097958  0.101962]
        """
        rho_n = np.asarray(rho, float)
        if method is not None or tolerance is not None:
            from eos_ref.methods import choice

            e_n = self._energy_array(e, rho_n) if self.needs_energy else None
            within = None if tolerance is None else _finite("tolerance", tolerance)
            return choice.pressure(self, np.ravel(rho_n), e_n, method, within).reshape(rho_n.shape)[()]
        from eos_ref.eos import compiled

        p_n = np.empty(rho_n.shape)
        outside = compiled.pressure_of_one_type(
            np.ravel(rho_n),
            self._energy_array(e, rho_n),
            STYLES.index(self.style),
            self.rho0,
            self.cs,
            float(self.parameter or 0.0),
            self.background,
            p_n.reshape(-1),
        )
        return (self._patched(p_n, rho_n) if outside else p_n)[()]

    def density(self, p: Number, e: Number = None) -> Number:
        r"""Inverse: density at which the pressure (background included) is ``p``; NaN where there is none.

        For a cubic law with :math:`A_3 < 0` the root on the monotone branch through :math:`\rho_0`; for
        Tait's laws the root >= 0, although an odd power has a negative one as well.
        """
        p = np.asarray(p, float) - self.background
        with np.errstate(all="ignore"):
            match self.style:
                case "linear":
                    return laws.linear_density(p, self.rho0, self.cs)
                case "cubic":
                    return laws.cubic_density(p, self.rho0, self.cs, self.parameter)
                case "tait/water" | "tait/general":
                    return laws.tait_density(p, self.rho0, self.cs, self.gamma)
                case _:
                    e_n = np.asarray(self._energy(e), float)
                    return laws.ideal_gas_density(p, np.where(e_n == 0, np.nan, e_n), self.gamma)

    def stiffness(self, rho: Number, e: Number = None) -> Number:
        r"""Derivative :math:`(\partial P/\partial\rho)_e`, local sound speed squared (velocity squared)."""
        rho = np.asarray(rho, float)
        # numpy's power of a scalar is another one than that of an array, and differs in the last bit.
        found = self._stiffness(np.atleast_1d(rho), e)
        return found.reshape(np.broadcast_shapes(rho.shape, np.shape(e) if self.needs_energy else ()))[()]

    def _stiffness(self, rho: FloatArray, e: Number) -> FloatArray:
        with np.errstate(all="ignore"):
            match self.style:
                case "linear":
                    found = laws.linear_stiffness(rho, self.rho0, self.cs)
                case "cubic":
                    found = laws.cubic_stiffness(rho, self.rho0, self.cs, self.parameter)
                case "tait/water" | "tait/general":
                    found = laws.tait_stiffness(rho, self.rho0, self.cs, self.gamma)
                case _:
                    found = laws.ideal_gas_stiffness(np.asarray(self._energy(e), float) + 0 * rho, self.gamma)
        return np.asarray(found)

    def sound_speed(self, rho: Number, e: Number = None) -> Number:
        r"""Local sound speed :math:`\sqrt{(\partial P/\partial\rho)_e}` (velocity); NaN where it is not real.

        For ideal/gas this is the isothermal value :math:`\sqrt{(\gamma-1)e}`; the adiabatic one is
        :math:`\sqrt\gamma` times larger.
        """
        with np.errstate(invalid="ignore"):
            return np.sqrt(self.stiffness(rho, e))

    @property
    def defined(self) -> Interval:
        """Densities at which the law has a real, finite value; a negative gamma excludes 0 as well."""
        if self.style != "tait/general" or self.gamma == round(self.gamma):
            return Interval(-math.inf, math.inf)
        return Interval(0.0, math.inf)

    @property
    def monotone(self) -> Interval:
        """Interval around rho0 on which the pressure grows with density: hyperbolic and invertible.

        For ideal/gas that takes a positive energy.
        """
        everywhere = Interval(-math.inf, math.inf)
        if self.style == "cubic":
            half_width = math.inf if self.gamma >= 0 else 1 / math.sqrt(3 * -self.gamma)
            return Interval(self.rho0 - half_width, self.rho0 + half_width)
        if self.style == "tait/general" and self.gamma != 1:
            return everywhere if self.gamma > 0 and self.gamma % 2 == 1 else Interval(0.0, math.inf)
        return everywhere

    def is_defined(self, rho: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Whether the law has a finite value at each density."""
        rho_n = np.asarray(rho, float)
        low, high = self.defined
        inside: npt.NDArray[np.bool_] = np.isfinite(rho_n) & (rho_n >= low) & (rho_n <= high)
        if self.style == "tait/general" and self.gamma < 0:
            inside &= rho_n != 0
        return inside

    def _energy(self, e: Number) -> Number:
        if e is None:
            raise InputError("energy", "ideal/gas needs the internal energy per unit mass of every particle")
        return e

    def _energy_array(self, e: npt.ArrayLike | None, rho_n: FloatArray) -> FloatArray:
        if not self.needs_energy:
            return np.empty(0)
        e_n = np.asarray(self._energy(e), float)
        if e_n.shape not in ((), rho_n.shape):
            raise InputError("energy", f"must be a scalar or of the density's shape {rho_n.shape}", e_n.shape)
        return np.full(rho_n.size, e_n) if e_n.shape == () else np.ravel(e_n)

    def _patched(self, p_n: FloatArray, rho_n: FloatArray) -> FloatArray:
        # Ratios that the branch-free power does not cover (negative, 0, beyond 2**1000, NaN): law in numpy.
        from eos_ref.eos import compiled

        low, high = compiled.power_range(self.rho0)
        with np.errstate(all="ignore"):
            outside = ~((rho_n >= low) & (rho_n <= high))
            p_n[outside] = self.evaluate(rho_n[outside])
        return p_n


def _finite(what: str, value: Any) -> float:
    try:
        finite = math.isfinite(value)
    except (TypeError, OverflowError):  # not a number, or a whole number beyond the largest float
        finite = False
    if not finite:
        raise InputError(what, "must be a finite number", value)
    return float(value)


@dataclass(frozen=True)
class EOSTable:
    """The equations of state of all atom types, type 1 first.

    Indexing is by atom type: ``table[1]`` is the law of type 1. Iteration begins with it.
    """

    laws: tuple[EOS, ...]

    def __post_init__(self) -> None:
        if not self.laws:
            raise InputError("equation of state", "must be given for every atom type", "none")

    def __getitem__(self, atom_type: int) -> EOS:
        if not 1 <= atom_type <= len(self.laws):
            raise InputError("atom type", f"must lie within 1 to {len(self.laws)}", atom_type)
        return self.laws[atom_type - 1]

    def __len__(self) -> int:
        return len(self.laws)

    def __iter__(self) -> Iterator[EOS]:
        return iter(self.laws)

    @property
    def needs_energy(self) -> bool:
        """Whether any type's law depends on the internal energy."""
        return any(law.needs_energy for law in self.laws)

    @cached_property
    def _columns(self) -> tuple[npt.NDArray[Any], ...]:
        return (
            np.array([STYLES.index(law.style) for law in self.laws]),
            np.array([law.rho0 for law in self.laws]),
            np.array([law.cs for law in self.laws]),
            np.array([law.parameter or 0.0 for law in self.laws]),
            np.array([law.background for law in self.laws]),
        )

    def pressure(
        self,
        rho_n: npt.ArrayLike,
        type_n: npt.ArrayLike,
        e_n: npt.ArrayLike | None = None,
        method: str | None = None,
        tolerance: float | None = None,
    ) -> FloatArray:
        """Return the pressure of every particle from the law of its own type.

        Parameters
        ----------
        rho_n : array_like, (n,)
            Density.
        type_n : array_like of int, (n,)
            Atom types, 1 to N.
        e_n : array_like, (n,), optional
            Internal energy per unit mass; needed if any type is an ideal/gas.
        method, tolerance : optional
            As for `EOS.pressure`; ``"auto"`` chooses for every type by itself.

        Returns
        -------
        ndarray of float64, (n,)
            Error bound as for `EOS.pressure`; NaN where a law is not defined.

        Raises
        ------
        InputError
            Arrays of different length, a type that is no whole number or outside 1 to N, or missing energies; a
            method or tolerance that `EOS.pressure` refuses.
        """
        from eos_ref.eos import compiled

        rho = np.ascontiguousarray(rho_n, float)
        types = np.ascontiguousarray(type_n)
        e = np.empty(0) if e_n is None else np.ascontiguousarray(e_n, float)
        if types.shape != rho.shape or rho.ndim != 1 or (e.size and e.shape != rho.shape):
            found = f"shapes rho {rho.shape}, type {types.shape}, e {e.shape}"
            raise InputError("per-atom arrays", "must have one value per particle", found)
        if types.size and types.dtype.kind not in "iu":
            raise InputError("atom type", "must be a whole number", str(types.dtype))
        if types.dtype not in (
            np.int32,
            np.int64,
        ):  # LAMMPS' own type; every other one would be compiled anew
            types = types.astype(np.int64)
        if rho.size and not (types.min() >= 1 and types.max() <= len(self)):
            found = f"{types.min()} to {types.max()}"
            raise InputError("atom type", f"must lie within 1 to {len(self)}", found)
        if self.needs_energy and not e.size and rho.size:
            raise InputError("energy", "ideal/gas needs the internal energy per unit mass of every particle")
        if len(self) == 1:
            return self.laws[0].pressure(rho, e if e.size else None, method, tolerance)
        p = np.empty(rho.shape)
        if method is not None or tolerance is not None:
            for t, law in enumerate(self.laws, 1):
                of_type = types == t
                p[of_type] = law.pressure(rho[of_type], e[of_type] if e.size else None, method, tolerance)
            return p
        if compiled.pressure(rho, e, types, *self._columns, p):
            for t, law in enumerate(self.laws, 1):
                if law.style == "tait/general":
                    p[types == t] = law._patched(p[types == t], rho[types == t])
        return p
