r"""Arrays that carry a bound on their rounding error: the bounds of the particle model, from its own formulas.

A `Rounded` array holds values and, per element, the largest difference that rounding can make between any two correct
evaluations of the formula it went through. Every operation passes the errors of its operands on and adds its own: two
units of the last place, one for each side and each once more because the other side may need an extra operation (a
reciprocal and a product for a quotient, say). A sum of k terms adds k roundings of the sum of the absolute terms, so
that it may be taken in any order. What is 0 without error stays so: its sums and products are 0 in any order. This is
running error analysis (Higham, Accuracy and Stability of Numerical Algorithms, section 3.3) with a rounding constant of
four unit roundoffs.

A comparison gives a `Decision`: where the operands are closer than their errors either answer is right, and what
depends on it has an error as large as the difference between the two outcomes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self

import numpy as np
import numpy.typing as npt

ROUNDING = 4 * 2.0**-53  # two roundings on either side
TINY = 2.0**-1074
Array = npt.NDArray[Any]


def value(x: Any) -> Array:
    """Return the values of an array of any kind."""
    return x.value if isinstance(x, Rounded) else np.asarray(x)


def error(x: Any) -> Array:
    """Return the errors of an array; 0 for plain numbers, which are exact."""
    return x.error if isinstance(x, Rounded) else np.zeros(np.shape(x))


def exact_zero(x: Any) -> Array:
    """Return where an array of any kind is 0 without error: in every correct evaluation."""
    return np.asarray((value(x) == 0) & (error(x) == 0))


def placed(part: Any, at: Array, rest: Any) -> Any:
    """Return a copy of an array of any kind, ``rest``, with the elements of ``part`` in the places ``at``."""
    values = value(rest).copy()
    values[at] = value(part)
    if not isinstance(part, Rounded) and not isinstance(rest, Rounded):
        return values
    errors = error(rest).copy()
    errors[at] = error(part)
    return Rounded(values, errors)


class Decision:
    """Outcome of a comparison: the answer for the values, and where rounding leaves it open."""

    __array_ufunc__ = None

    def __init__(self, answer: Any, open_: Any) -> None:
        self.answer, self.open = np.asarray(answer), np.asarray(open_)

    @classmethod
    def of(cls, flags: Any) -> Decision:
        """Return plain flags as a decision that is nowhere open; a decision as it is."""
        return flags if isinstance(flags, Decision) else cls(flags, np.zeros(np.shape(flags), bool))

    def __and__(self, other: Any) -> Decision:
        b = Decision.of(other)
        open_ = (self.open & (b.answer | b.open)) | (b.open & (self.answer | self.open))
        return Decision(self.answer & b.answer, open_)

    __rand__ = __and__

    def __invert__(self) -> Decision:
        return Decision(~self.answer, self.open)

    def __or__(self, other: Any) -> Decision:
        return ~(~self & ~Decision.of(other))

    __ror__ = __or__

    def __getitem__(self, at: Any) -> Decision:
        return Decision(self.answer[at], self.open[at])

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        """See `eos_ref.numbers.elementary.where`."""
        return _choose(condition, a, b)


def _choose(condition: Any, a: Any, b: Any) -> Rounded:
    if not isinstance(condition, Decision):
        return Rounded.known(np.where(condition, value(a), value(b)), np.where(condition, error(a), error(b)))
    chosen = np.where(condition.answer, value(a), value(b))
    either = np.abs(value(a) - value(b)) + np.maximum(error(a), error(b))
    return Rounded(chosen, np.where(condition.open, either, np.where(condition.answer, error(a), error(b))))


class Rounded:
    """Values with the largest difference that rounding makes between two correct evaluations."""

    __array_ufunc__ = None  # so that numpy leaves array * Rounded to us
    loops: Any = None  # operations, compiled: `eos_ref.evaluation.rounded_loops`, once it is imported

    def __init__(self, value: Any, error: Any = 0.0) -> None:
        self.value = np.asarray(value, float)
        bound = np.asarray(error, float)
        if np.isnan(bound).any():  # inf times 0: nothing is known
            bound = np.where(np.isnan(bound), np.inf, bound)
        self.error = bound if bound.shape == self.value.shape else np.broadcast_to(bound, self.value.shape)

    @classmethod
    def known(cls, value: Array, error: Array) -> Self:
        """Return an array of values and errors of the same shape, all of them known to be numbers."""
        made = cls.__new__(cls)
        made.value, made.error = value, error
        return made

    def _compiled(self, name: str, a: Any, b: Any) -> Rounded | None:
        """Return an operation on arrays, compiled; None: it is left to the arrays."""
        return self.loops.operation(name, a, b) if self.loops else None

    def _rounded(self, value: Array, error: Array, underflow: float = TINY) -> Rounded:
        """Add the rounding of one operation; sums and differences do not underflow."""
        return Rounded(value, error + ROUNDING * np.abs(value) + underflow)

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of every axis of the values."""
        return self.value.shape

    def __getitem__(self, at: Any) -> Rounded:
        return Rounded.known(np.asarray(self.value[at]), np.asarray(self.error[at]))

    def __len__(self) -> int:
        return len(self.value)

    def __neg__(self) -> Rounded:
        return Rounded.known(np.asarray(-self.value), self.error)

    def __abs__(self) -> Rounded:
        return Rounded.known(np.asarray(np.abs(self.value)), self.error)

    def __add__(self, other: Any) -> Rounded:
        if (compiled := self._compiled("add", self, other)) is not None:
            return compiled
        return self._rounded(self.value + value(other), self.error + error(other), 0.0)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Rounded:
        if (compiled := self._compiled("subtract", self, other)) is not None:
            return compiled
        return self._rounded(self.value - value(other), self.error + error(other), 0.0)

    def __rsub__(self, other: Any) -> Rounded:
        if (compiled := self._compiled("subtract", other, self)) is not None:
            return compiled
        return self._rounded(value(other) - self.value, self.error + error(other), 0.0)

    def __mul__(self, other: Any) -> Rounded:
        if (compiled := self._compiled("multiply", self, other)) is not None:
            return compiled
        a, b, da, db = self.value, value(other), self.error, error(other)
        exact = not isinstance(other, Rounded)
        with np.errstate(invalid="ignore"):  # an unbounded error times 0 stays unbounded: NaN is never inside a bound
            x = a * b
            carried = np.abs(b) * da if exact else np.abs(a) * db + np.abs(b) * da + da * db
            bound = carried + ROUNDING * np.abs(x) + TINY
        if not (a.all() and b.all()):
            none = (exact_zero(self) & np.isfinite(db)) | (exact_zero(other) & np.isfinite(da))
            bound = np.where(none, 0.0, bound)
        return Rounded(x, bound)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Rounded:
        if (compiled := self._compiled("divide", self, other)) is not None:
            return compiled
        return _quotient(self.value, self.error, value(other), error(other))

    def __rtruediv__(self, other: Any) -> Rounded:
        if (compiled := self._compiled("divide", other, self)) is not None:
            return compiled
        return _quotient(value(other), error(other), self.value, self.error)

    def __pow__(self, power: Any) -> Rounded:
        """Return the power; the slope is the largest of the interval, at one of its ends."""
        with np.errstate(all="ignore"):
            x = self.value**power
            ends = (self.value - self.error, self.value + self.error)
            slope = np.maximum(*(np.abs(power * end**power / end) for end in ends))
        return Rounded(x, slope * self.error + (2 + np.abs(power)) * ROUNDING * np.abs(x) + TINY)

    def sqrt(self) -> Rounded:
        r"""Return the square root; the error is that of the interval, which near 0 is far larger than a slope says.

        :math:`|\sqrt a-\sqrt b| = |a-b|/(\sqrt a+\sqrt b) \le \sqrt{|a-b|}`; the latter counts at 0.
        """
        low = np.sqrt(np.maximum(self.value - self.error, 0.0))
        x = np.sqrt(self.value)
        with np.errstate(invalid="ignore", divide="ignore"):
            spread = np.where(self.error > 0, np.fmin(self.error / (x + low), np.sqrt(self.error)), 0.0)
        return self._rounded(x, spread)

    def maximum(self, other: Any) -> Rounded:
        """Return the larger of two; a Lipschitz function, so no decision is open."""
        return Rounded(np.maximum(self.value, value(other)), np.maximum(self.error, error(other)))

    def minimum(self, other: Any) -> Rounded:
        """Return the smaller of two."""
        return Rounded(np.minimum(self.value, value(other)), np.maximum(self.error, error(other)))

    def where(self, condition: Any, a: Any, b: Any) -> Rounded:
        """See `eos_ref.numbers.elementary.where`."""
        return _choose(condition, a, b)

    def _compare(self, other: Any, relation: Callable[[Any, Any], Any]) -> Decision:
        a, b = self.value, value(other)
        errors = self.error + error(other)
        # Not "<=": an error that is no number leaves everything open.
        return Decision(relation(a, b), ~((np.abs(a - b) > errors) | ((a == b) & (errors == 0))))

    def __eq__(self, other: object) -> Any:
        """Return where the values are equal, as plain flags: a guard against dividing by an exact 0."""
        return self.value == value(other)

    __hash__ = None  # type: ignore[assignment]

    def __lt__(self, other: Any) -> Decision:
        return self._compare(other, np.less)

    def __le__(self, other: Any) -> Decision:
        return self._compare(other, np.less_equal)

    def __gt__(self, other: Any) -> Decision:
        return self._compare(other, np.greater)

    def __ge__(self, other: Any) -> Decision:
        return self._compare(other, np.greater_equal)

    def sum_by(self, row_p: Array, n: int) -> Rounded:
        """Return the sums (n,) of the elements with each row number, in any order."""
        if self.loops and (compiled := self.loops.sum_by(self, row_p, n)) is not None:
            return compiled  # type: ignore[no-any-return]
        count_n = np.bincount(row_p, minlength=n)
        absolute_n = np.bincount(row_p, np.abs(self.value), n)
        error_n = np.bincount(row_p, self.error, n) + count_n * (ROUNDING * absolute_n)
        return Rounded(np.bincount(row_p, self.value, n), error_n)


def _quotient(a: Array, da: Array, b: Array, db: Array) -> Rounded:
    with np.errstate(all="ignore"):
        x = a / b
        room = np.abs(b) - db
        error = np.where(room > 0, (da + np.abs(x) * db) / room, np.inf)
        error = error + ROUNDING * np.abs(x) + TINY
    if not a.all():
        error = np.where((a == 0) & (da == 0) & (room > 0), 0.0, error)
    return Rounded(x, error)
