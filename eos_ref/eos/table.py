"""Equations of state per atom type: parameters, pressure, inverse, sound speed, domain."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from eos_ref.eos.law import Interval, Law
from eos_ref.eos.registry import LAWS, STYLES, Style
from eos_ref.errors import InputError

FloatArray = npt.NDArray[np.float64]


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
        ratio gamma of ideal/gas (> 1). The manual does not restrict the sign of the first two, and both signs have a
        meaning: with :math:`A_3 < 0` the pressure grows with density between the spinodals, with gamma < 0 everywhere,
        as :math:`dP/d\rho = c^2 (\rho/\rho_0)^{\gamma-1}` (Chaplygin's gas is gamma = -1).
    background : float
        Background pressure :math:`P_b` (pressure), added to the law's value. Default 0.

    Raises
    ------
    InputError
        A parameter is missing, superfluous, not a finite number or outside its domain.

    Source: LAMMPS manual, fix rheo/pressure and fix rheo (defaults).
    """

    by_method: ClassVar[Callable[..., FloatArray]]  # for `pressure`; set by `eos_ref`, as methods rest on laws

    style: Style
    rho0: float = 1.0
    cs: float = 1.0
    parameter: float | None = None
    background: float = 0.0

    def __post_init__(self) -> None:
        if self.style not in LAWS:
            raise InputError("pressure style", f"must be one of {', '.join(STYLES)}", self.style)
        name = self.law.parameter
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
        if self.parameter is not None and not self.law.allows(self.parameter):
            raise InputError(f"{name} of {self.style}", self.law.rule, self.parameter)

    @property
    def law(self) -> Law:
        """Return the record of the style."""
        return LAWS[self.style]

    @property
    def exponent(self) -> float | None:
        """Return the exponent of Tait's law (7 for water); None for the other laws."""
        return self.law.exponent(self.parameter or 0.0)

    @property
    def gamma(self) -> float:
        """Return the exponent of Tait's law (7 for water) or heat capacity ratio of a gas.

        Raises
        ------
        AttributeError
            The law has neither.
        """
        value = self.parameter if self.law.parameter == "gamma" else self.exponent
        if value is None:
            raise AttributeError(f"{self.style} has no gamma")
        return value

    @property
    def needs_energy(self) -> bool:
        """Return whether the law depends on the internal energy."""
        return self.law.needs_energy

    @property
    def settings(self) -> tuple[int, float, float, float, float]:
        """Return the place of the style in `STYLES`, rho0, cs, parameter (or 0), background, for compiled loops."""
        return STYLES.index(self.style), self.rho0, self.cs, self.parameter or 0.0, self.background

    def evaluate(self, rho: Any, e: Any = None, convert: Any = None) -> Any:
        """Return the pressure in the number type of ``rho``: numpy arrays and scalars of any float type, or Arb balls.

        ``convert`` turns the parameters into that type (for Arb: ``flint.arb``); numpy's types need none.
        """
        # numpy rounds a Python float to float32 by itself; longdouble needs products of parameters in full.
        of: Any = convert or (np.longdouble if getattr(rho, "dtype", None) == np.longdouble else float)
        rho0, cs, background = of(self.rho0), of(self.cs), of(self.background)
        parameter = None if self.parameter is None else of(self.parameter)
        p = self.law.pressure(rho, self._energy(e), rho0, cs, parameter)
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
            Of ``"auto"``, which needs it: the largest error allowed, relative to the sum of the absolute values of
            the law and the background pressure. The worst error of a method is searched for over the interval that the
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
            e_n = self._energy_array(e, rho_n) if self.needs_energy else None
            within = None if tolerance is None else _finite("tolerance", tolerance)
            return self.by_method(np.ravel(rho_n), e_n, method, within).reshape(rho_n.shape)[()]
        from eos_ref.eos import compiled

        p_n = np.empty(rho_n.shape)
        e_n = self._energy_array(e, rho_n)
        outside = compiled.pressure_of_one_type(np.ravel(rho_n), e_n, *self.settings, p_n.reshape(-1))
        return (self._patched(p_n, rho_n) if outside else p_n)[()]

    def density(self, p: npt.ArrayLike, e: npt.ArrayLike | None = None) -> Any:
        r"""Return the density at which the pressure (background included) is ``p``; NaN where no density has it.

        For a cubic law with :math:`A_3 < 0` the root on the monotone branch through :math:`\rho_0`; for
        Tait's laws the root >= 0, although an odd power has a negative one as well.
        """
        p = np.asarray(p, float) - self.background
        with np.errstate(all="ignore"):
            return self.law.density(p, self._energy_n(e), self.rho0, self.cs, self.parameter)

    def stiffness(self, rho: npt.ArrayLike, e: npt.ArrayLike | None = None) -> Any:
        r"""Return the derivative :math:`(\partial P/\partial\rho)_e`, local sound speed squared (velocity squared)."""
        rho = np.asarray(rho, float)
        # numpy's powers of a scalar and of an array differ in the last bit.
        with np.errstate(all="ignore"):
            stiffness = self.law.stiffness(np.atleast_1d(rho), self._energy_n(e), self.rho0, self.cs, self.parameter)
        shape = np.broadcast_shapes(rho.shape, np.shape(np.asarray(e)) if self.needs_energy else ())
        return np.asarray(stiffness).reshape(shape)[()]

    def sound_speed(self, rho: npt.ArrayLike, e: npt.ArrayLike | None = None) -> Any:
        r"""Return the local sound speed :math:`\sqrt{(\partial P/\partial\rho)_e}` (velocity); NaN if not real.

        For ideal/gas this is the isothermal value :math:`\sqrt{(\gamma-1)e}`; the adiabatic one is
        :math:`\sqrt\gamma` times larger.
        """
        with np.errstate(invalid="ignore"):
            return np.sqrt(self.stiffness(rho, e))

    @property
    def defined(self) -> Interval:
        """Return the interval of densities with a real, finite value; a negative gamma excludes 0 as well."""
        return self.law.defined(self.parameter or 0.0)

    @property
    def monotone(self) -> Interval:
        """Return the interval around rho0 on which the pressure grows with density: hyperbolic and invertible.

        For a law that depends on the energy, the energy is taken to be positive.
        """
        return self.law.monotone(self.rho0, self.parameter or 0.0)

    def is_defined(self, rho: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Return whether the law has a finite value at each density, in the shape of ``rho``."""
        rho_n = np.asarray(rho, float)
        low, high = self.defined
        inside: npt.NDArray[np.bool_] = np.isfinite(rho_n) & (rho_n >= low) & (rho_n <= high)
        if self.law.has_pole(self.parameter or 0.0):
            inside &= rho_n != 0
        return inside

    def _energy(self, e: Any) -> Any:
        if e is None and self.needs_energy:
            raise InputError("energy", f"{self.style} needs the internal energy per unit mass of every particle")
        return e

    def _energy_n(self, e: Any) -> Any:
        return np.asarray(self._energy(e), float) if self.needs_energy else None

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


def examples(rho0: float = 1.0, cs: float = 1.0) -> tuple[EOS, ...]:
    """Return one law of every style, in order, no two of them the same."""
    return tuple(EOS(law.style, rho0, cs, law.example) for law in LAWS.values())


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
        """Return whether any type's law depends on the internal energy."""
        return bool(self.style_with_energy)

    @property
    def style_with_energy(self) -> str:
        """Return the first style that depends on the energy; empty if none does."""
        return next((law.style for law in self.laws if law.needs_energy), "")

    @cached_property
    def _columns(self) -> tuple[npt.NDArray[Any], ...]:
        return tuple(np.array(column) for column in zip(*(eos.settings for eos in self.laws), strict=True))

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

        rho, types, e = self._checked(rho_n, type_n, e_n)
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
                if law.law.uses_powm1:
                    p[types == t] = law._patched(p[types == t], rho[types == t])
        return p

    def _checked(
        self, rho_n: npt.ArrayLike, type_n: npt.ArrayLike, e_n: npt.ArrayLike | None
    ) -> tuple[FloatArray, npt.NDArray[Any], FloatArray]:
        """Return densities, types and energies (none: an empty array) as compiled loops take them."""
        rho = np.ascontiguousarray(rho_n, float)
        types = np.ascontiguousarray(type_n)
        e = np.empty(0) if e_n is None else np.ascontiguousarray(e_n, float)
        if types.shape != rho.shape or rho.ndim != 1 or (e.size and e.shape != rho.shape):
            found = f"shapes rho {rho.shape}, type {types.shape}, e {e.shape}"
            raise InputError("per-atom arrays", "must have one value per particle", found)
        if types.size and types.dtype.kind not in "iu":
            raise InputError("atom type", "must be a whole number", str(types.dtype))
        if types.dtype not in (np.int32, np.int64):  # LAMMPS' own types; any other would need another compilation
            types = types.astype(np.int64)
        if rho.size and not (types.min() >= 1 and types.max() <= len(self)):
            found = f"{types.min()} to {types.max()}"
            raise InputError("atom type", f"must lie within 1 to {len(self)}", found)
        if self.needs_energy and not e.size and rho.size:
            raise InputError(
                "energy", f"{self.style_with_energy} needs the internal energy per unit mass of every particle"
            )
        return rho, types, e
