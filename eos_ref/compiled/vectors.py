"""Short vectors for compiled loops, kept in registers: their length, a dimension, is known when a loop is compiled.

A row of a two-dimensional array becomes a vector and back. ``+``, ``-``, ``*`` and ``/`` act on every component at
once, ``*`` also with a number; numba by itself would treat the components one after the other. The length of a row is
given by a tuple of that length (``like``). Nothing here is a formula of the model. All functions exist in
compiled code only.

Loops take 0.5 (gradients of a velocity, 2D and 3D) to 0.8 (moments of RK1, 2D) of the time of the same sums written out
component by component, on two cores of an AMD EPYC; ``eos-ref bench model`` measures the gradients in 2D.
"""

# mypy: disable-error-code="untyped-decorator,no-untyped-def,misc"

from __future__ import annotations

import operator
from itertools import combinations_with_replacement
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.cgutils import get_or_insert_function
from numba.extending import intrinsic, models, overload, register_model

from eos_ref.compiled import registers as reg


class Vector(types.Type):
    """Type of a vector of doubles."""

    def __init__(self, size: int) -> None:
        super().__init__(f"Vector({size})")
        self.size = size


@register_model(Vector)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, vector: Vector) -> None:
        super().__init__(
            manager, vector, ir.LiteralStructType([ir.VectorType(reg.DOUBLE, w) for w in reg.widths(vector.size)])
        )


def graded(dimension: int, degree: int) -> list[tuple[int, ...]]:
    """Return the monomials up to a degree, each as the axes that it multiplies: (), (0,), (1,), (0, 0), (0, 1), ..."""
    return [axes for k in range(degree + 1) for axes in combinations_with_replacement(range(dimension), k)]


# --- arithmetic


def _componentwise(operation: str) -> Any:
    @intrinsic
    def function(typing_context, a, b):
        def code(context, builder, signature, args):
            pairs = zip(*(reg.unpacked(builder, arg) for arg in args), strict=True)
            return reg.packed(builder, [getattr(builder, operation)(x, y) for x, y in pairs])

        return a(a, b), code

    return function


_plus, _minus, _times, _over = map(_componentwise, ("fadd", "fsub", "fmul", "fdiv"))


@intrinsic
def _scaled(typing_context, factor, a):
    def code(context, builder, signature, args):
        nothing = ir.Constant(ir.VectorType(reg.DOUBLE, 1), ir.Undefined)
        number = [builder.insert_element(nothing, args[0], reg.LANE(0))]
        return reg.packed(
            builder, reg.multiplied(builder, reg.picked(builder, number, [0] * a.size), reg.unpacked(builder, args[1]))
        )

    return a(types.float64, a), code


@overload(operator.add)
def _add(a, b):
    return (lambda a, b: _plus(a, b)) if isinstance(a, Vector) else None


@overload(operator.sub)
def _sub(a, b):
    return (lambda a, b: _minus(a, b)) if isinstance(a, Vector) else None


@overload(operator.mul)
def _mul(a, b):
    if not isinstance(b, Vector):
        return None
    return (lambda a, b: _times(a, b)) if isinstance(a, Vector) else (lambda a, b: _scaled(a, b))


@overload(operator.truediv)
def _truediv(a, b):
    return (lambda a, b: _over(a, b)) if isinstance(a, Vector) and isinstance(b, Vector) else None


@intrinsic
def roots(typing_context, a):
    """Return the square root of every component."""

    def code(context, builder, signature, args):
        result = []
        for register in reg.unpacked(builder, args[0]):
            form = ir.FunctionType(register.type, [register.type])
            root = get_or_insert_function(builder.module, form, f"llvm.sqrt.v{register.type.count}f64")
            result.append(builder.call(root, [register]))
        return reg.packed(builder, result)

    return a(a), code


@intrinsic
def vector(typing_context, parts):
    """Return the vector of the numbers in a tuple, as many as fit one register."""
    (width,) = reg.widths(len(parts))

    def code(context, builder, signature, args):
        register = ir.Constant(ir.VectorType(reg.DOUBLE, width), ir.Undefined)
        for k in range(len(parts)):
            register = builder.insert_element(register, builder.extract_value(args[0], k), reg.LANE(k))
        return reg.packed(builder, [register])

    return Vector(len(parts))(parts), code


@intrinsic
def zero(typing_context, like):
    """Return a vector of zeros."""
    kind = Vector(len(like))

    def code(context, builder, signature, args):
        return ir.Constant(context.get_value_type(kind), None)

    return kind(like), code


@intrinsic
def joined(typing_context, a, b):
    """Return the components of one vector followed by those of another of the same length, each in one register."""

    def code(context, builder, signature, args):
        (left,), (right,) = (reg.unpacked(builder, arg) for arg in args)
        width = left.type.count
        lanes: list[int | None] = [*range(a.size), *range(width, width + a.size)]
        return reg.packed(
            builder, [reg.resized(builder, reg.shuffled(builder, left, right, lanes), *reg.widths(2 * a.size))]
        )

    return Vector(2 * a.size)(a, b), code


@intrinsic
def outer(typing_context, a, b):
    """Return all products a[k]*b[l], the second index running fastest."""
    size = a.size * b.size

    def code(context, builder, signature, args):
        left = reg.picked(builder, reg.unpacked(builder, args[0]), [k // b.size for k in range(size)])
        right = reg.picked(builder, reg.unpacked(builder, args[1]), [k % b.size for k in range(size)])
        return reg.packed(builder, reg.multiplied(builder, left, right))

    return Vector(size)(a, b), code


@intrinsic
def dot(typing_context, a, b):
    """Return the scalar product, summed from the first component on."""

    def code(context, builder, signature, args):
        product = reg.multiplied(builder, *(reg.unpacked(builder, arg) for arg in args))
        (total,) = reg.sum_of_pieces(builder, product, [[k] for k in range(a.size)])
        return builder.extract_element(total, reg.LANE(0))

    return types.float64(a, b), code


@intrinsic
def matrix_times(typing_context, matrix, a):
    """Multiply a matrix, given row after row, by a vector."""
    rows, size = matrix.size // a.size, a.size

    def code(context, builder, signature, args):
        repeated = reg.picked(builder, reg.unpacked(builder, args[1]), [k % size for k in range(matrix.size)])
        product = reg.multiplied(builder, reg.unpacked(builder, args[0]), repeated)
        return reg.packed(
            builder, reg.sum_of_pieces(builder, product, [[*range(k, matrix.size, size)] for k in range(size)])
        )

    return Vector(rows)(matrix, a), code


@intrinsic
def columns_times(typing_context, matrix, a):
    """Multiply a matrix, given column after column, by a vector."""
    rows, size = matrix.size // a.size, a.size

    def code(context, builder, signature, args):
        repeated = reg.picked(builder, reg.unpacked(builder, args[1]), [k // rows for k in range(matrix.size)])
        product = reg.multiplied(builder, reg.unpacked(builder, args[0]), repeated)
        return reg.packed(
            builder, reg.sum_of_pieces(builder, product, [[*range(k * rows, (k + 1) * rows)] for k in range(size)])
        )

    return Vector(rows)(matrix, a), code


# --- monomials


def _degree(dimension: int, count: int) -> int:
    return next(k for k in range(9) if len(graded(dimension, k)) == count)


@intrinsic
def monomials(typing_context, u, like):
    """Return products of components in the order of `graded`, as many as ``like`` has entries."""
    degree = _degree(u.size, len(like))

    def code(context, builder, signature, args):
        (x,) = reg.unpacked(builder, args[0])
        (ones,), width = reg.constants([1.0] * u.size), x.type.count
        lanes: list[int | None] = [0, *range(width, width + u.size)]
        products = [reg.resized(builder, reg.shuffled(builder, ones, x, lanes), *reg.widths(len(lanes)))]
        reached = 1
        while reached < degree:  # the product of any two is one of twice the degree
            parts, reached = graded(u.size, reached), min(2 * reached, degree)
            wanted = graded(u.size, reached)
            left = [parts.index(axes[: len(axes) // 2]) for axes in wanted]
            right = [parts.index(axes[len(axes) // 2 :]) for axes in wanted]
            products = reg.multiplied(
                builder, reg.picked(builder, products, left), reg.picked(builder, products, right)
            )
        return reg.packed(builder, products)

    return Vector(len(like))(u, like), code


@intrinsic
def mirrored(typing_context, products, u):
    """Return the monomials of -u, given those of u."""
    sign = [(-1.0) ** len(axes) for axes in graded(u.size, _degree(u.size, products.size))]

    def code(context, builder, signature, args):
        return reg.packed(builder, reg.multiplied(builder, reg.unpacked(builder, args[0]), reg.constants(sign)))

    return products(products, u), code


# --- rows of arrays


def _bytes(array: Any) -> int:
    """Return the bytes that a row is aligned to: those of one entry."""
    return int(array.dtype.bitwidth // 8)


def _places(context: Any, builder: Any, signature: Any, args: Any, size: int) -> list[reg.Place]:
    """Return where the parts of a row lie; the array is contiguous, its rows as long as the vector."""
    array_type, index_type = signature.args[:2]
    data = context.make_array(array_type)(context, builder, value=args[0]).data
    k = context.cast(builder, args[1], index_type, types.intp)
    first = builder.mul(k, context.get_constant(types.intp, size))
    return reg.places(builder, data, first, context.get_data_type(array_type.dtype), size)


@intrinsic
def row(typing_context, array_nc, k, like):
    """Return row k as a vector of as many components as ``like``; whole numbers become doubles."""

    def code(context, builder, signature, args):
        at = _places(context, builder, signature, args, len(like))
        return reg.packed(builder, reg.loaded(builder, at, _bytes(array_nc)))

    return Vector(len(like))(array_nc, k, like), code


@intrinsic
def put(typing_context, array_nc, k, vector):
    """Store a vector as row k."""

    def code(context, builder, signature, args):
        at = _places(context, builder, signature, args, vector.size)
        reg.store(builder, reg.unpacked(builder, args[2]), at, _bytes(array_nc))
        return context.get_dummy_value()

    return types.none(array_nc, k, vector), code


@intrinsic
def add_to(typing_context, array_nc, k, vector):
    """Add a vector to row k."""

    def code(context, builder, signature, args):
        at = _places(context, builder, signature, args, vector.size)
        before = reg.loaded(builder, at, _bytes(array_nc))
        reg.store(builder, reg.added(builder, before, reg.unpacked(builder, args[2])), at, _bytes(array_nc))
        return context.get_dummy_value()

    return types.none(array_nc, k, vector), code
