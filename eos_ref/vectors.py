"""Short vectors for compiled loops, one register each: their length, a dimension, is known when a loop is compiled.

A row of a two-dimensional array becomes a vector and back. ``+``, ``-``, ``*`` and ``/`` act on every component at
once, ``*`` also with a number; numba by itself would treat the components one after the other. Which row length is
meant is said by a tuple of that length (``like``). Nothing here is a formula of the model. All functions exist in
compiled code only.
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

_DOUBLE, _LANE = ir.DoubleType(), ir.IntType(32)
_WIDTH = 8  # doubles in the widest registers


class Vector(types.Type):
    """Type of a vector of doubles."""

    def __init__(self, size: int) -> None:
        super().__init__(f"Vector({size})")
        self.size = size


@register_model(Vector)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, vector: Vector) -> None:
        registers = [ir.VectorType(_DOUBLE, width) for width in _widths(vector.size)]
        super().__init__(manager, vector, ir.LiteralStructType(registers))


def _widths(size: int) -> list[int]:
    """Registers that hold a vector. The last may be wider than what is left: only powers of two stay in registers."""
    left = size % _WIDTH
    return [_WIDTH] * (size // _WIDTH) + ([1 << (left - 1).bit_length()] if left else [])


def _registers(builder: Any, vector: Any) -> list[Any]:
    return [builder.extract_value(vector, k) for k in range(len(vector.type.elements))]


def _vector(builder: Any, registers: list[Any]) -> Any:
    found = ir.Constant(ir.LiteralStructType([register.type for register in registers]), ir.Undefined)
    for k, register in enumerate(registers):
        found = builder.insert_value(found, register, k)
    return found


def _shuffled(builder: Any, register: Any, other: Any, lanes: list[int | None]) -> Any:
    """Lanes of a register, and those of another counted on; None: of no meaning, the first of the other."""
    mask = [ir.Constant(_LANE, register.type.count if lane is None else lane) for lane in lanes]
    return builder.shuffle_vector(register, other, ir.Constant(ir.VectorType(_LANE, len(mask)), mask))


def _picked(builder: Any, registers: list[Any], places: list[int]) -> list[Any]:
    """Registers of the components at these places."""
    found, start = [], 0
    for width in _widths(len(places)):
        wanted = dict(enumerate(places[start : start + width]))
        parts: Any = None
        for k, register in enumerate(registers):
            lanes = {lane: place - k * _WIDTH for lane, place in wanted.items() if place // _WIDTH == k}
            if not lanes:
                continue
            nothing = ir.Constant(register.type, ir.Undefined)
            part = _shuffled(builder, register, nothing, [lanes.get(lane) for lane in range(width)])
            choice: list[int | None] = [lane + width * (lane in lanes) for lane in range(width)]
            parts = part if parts is None else _shuffled(builder, parts, part, choice)
        found.append(parts)
        start += width
    return found


def _added(builder: Any, a: list[Any], b: list[Any]) -> list[Any]:
    return [builder.fadd(x, y) for x, y in zip(a, b, strict=True)]


def _multiplied(builder: Any, a: list[Any], b: list[Any]) -> list[Any]:
    return [builder.fmul(x, y) for x, y in zip(a, b, strict=True)]


def graded(dimension: int, degree: int) -> list[tuple[int, ...]]:
    """Monomials up to a degree, each as the axes that it multiplies, by degree: (), (0,), (1,), (0, 0), (0, 1), ..."""
    return [axes for k in range(degree + 1) for axes in combinations_with_replacement(range(dimension), k)]


# --- arithmetic


def _componentwise(operation: str) -> Any:
    @intrinsic
    def function(typing_context, a, b):
        def code(context, builder, signature, args):
            pairs = zip(*(_registers(builder, arg) for arg in args), strict=True)
            return _vector(builder, [getattr(builder, operation)(x, y) for x, y in pairs])

        return a(a, b), code

    return function


_plus, _minus, _times, _over = map(_componentwise, ("fadd", "fsub", "fmul", "fdiv"))


@intrinsic
def _scaled(typing_context, factor, a):
    def code(context, builder, signature, args):
        nothing = ir.Constant(ir.VectorType(_DOUBLE, 1), ir.Undefined)
        number = [builder.insert_element(nothing, args[0], _LANE(0))]
        return _vector(
            builder, _multiplied(builder, _picked(builder, number, [0] * a.size), _registers(builder, args[1]))
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
    """Square root of every component."""

    def code(context, builder, signature, args):
        found = []
        for register in _registers(builder, args[0]):
            form = ir.FunctionType(register.type, [register.type])
            root = get_or_insert_function(builder.module, form, f"llvm.sqrt.v{register.type.count}f64")
            found.append(builder.call(root, [register]))
        return _vector(builder, found)

    return a(a), code


@intrinsic
def vector(typing_context, parts):
    """Vector of the numbers in a tuple, as many as fit one register."""
    (width,) = _widths(len(parts))

    def code(context, builder, signature, args):
        found = ir.Constant(ir.VectorType(_DOUBLE, width), ir.Undefined)
        for k in range(len(parts)):
            found = builder.insert_element(found, builder.extract_value(args[0], k), _LANE(k))
        return _vector(builder, [found])

    return Vector(len(parts))(parts), code


@intrinsic
def zero(typing_context, like):
    """Vector of zeros."""
    found = Vector(len(like))

    def code(context, builder, signature, args):
        return ir.Constant(context.get_value_type(found), None)

    return found(like), code


@intrinsic
def joined(typing_context, a, b):
    """Components of one vector followed by those of another of the same length, each in one register."""

    def code(context, builder, signature, args):
        (left,), (right,) = (_registers(builder, arg) for arg in args)
        width = left.type.count
        lanes: list[int | None] = [*range(a.size), *range(width, width + a.size)]
        (total,) = _widths(2 * a.size)
        return _vector(builder, [_shuffled(builder, left, right, lanes + [None] * (total - len(lanes)))])

    return Vector(2 * a.size)(a, b), code


@intrinsic
def outer(typing_context, a, b):
    """All products a[k]*b[l], the second index running fastest."""
    size = a.size * b.size

    def code(context, builder, signature, args):
        left = _picked(builder, _registers(builder, args[0]), [k // b.size for k in range(size)])
        right = _picked(builder, _registers(builder, args[1]), [k % b.size for k in range(size)])
        return _vector(builder, _multiplied(builder, left, right))

    return Vector(size)(a, b), code


def _sum_of_pieces(builder: Any, registers: list[Any], pieces: list[list[int]]) -> list[Any]:
    total = _picked(builder, registers, pieces[0])
    for piece in pieces[1:]:
        total = _added(builder, total, _picked(builder, registers, piece))
    return total


@intrinsic
def dot(typing_context, a, b):
    """Scalar product, summed from the first component on."""

    def code(context, builder, signature, args):
        product = _multiplied(builder, *(_registers(builder, arg) for arg in args))
        (total,) = _sum_of_pieces(builder, product, [[k] for k in range(a.size)])
        return builder.extract_element(total, _LANE(0))

    return types.float64(a, b), code


@intrinsic
def matrix_times(typing_context, matrix, a):
    """Matrix, given row after row, times a vector."""
    rows, size = matrix.size // a.size, a.size

    def code(context, builder, signature, args):
        repeated = _picked(builder, _registers(builder, args[1]), [k % size for k in range(matrix.size)])
        product = _multiplied(builder, _registers(builder, args[0]), repeated)
        return _vector(builder, _sum_of_pieces(builder, product, [[*range(k, matrix.size, size)] for k in range(size)]))

    return Vector(rows)(matrix, a), code


@intrinsic
def columns_times(typing_context, matrix, a):
    """Matrix, given column after column, times a vector."""
    rows, size = matrix.size // a.size, a.size

    def code(context, builder, signature, args):
        repeated = _picked(builder, _registers(builder, args[1]), [k // rows for k in range(matrix.size)])
        product = _multiplied(builder, _registers(builder, args[0]), repeated)
        return _vector(
            builder, _sum_of_pieces(builder, product, [[*range(k * rows, (k + 1) * rows)] for k in range(size)])
        )

    return Vector(rows)(matrix, a), code


# --- monomials


def _degree(dimension: int, count: int) -> int:
    return next(k for k in range(9) if len(graded(dimension, k)) == count)


@intrinsic
def monomials(typing_context, u, like):
    """Products of components in the order of `graded`, as many as ``like`` has entries."""
    degree = _degree(u.size, len(like))

    def code(context, builder, signature, args):
        one = ir.Constant(ir.VectorType(_DOUBLE, 1), [1.0])
        ones = _picked(builder, [one], [0] * u.size)[0]
        (x,) = _registers(builder, args[0])
        lanes: list[int | None] = [0, *range(x.type.count, x.type.count + u.size)]
        (width,) = _widths(len(lanes))
        found = [_shuffled(builder, ones, x, lanes + [None] * (width - len(lanes)))]
        known = 1
        while known < degree:  # the product of any two is one of twice the degree
            parts, known = graded(u.size, known), min(2 * known, degree)
            wanted = graded(u.size, known)
            left = [parts.index(axes[: len(axes) // 2]) for axes in wanted]
            right = [parts.index(axes[len(axes) // 2 :]) for axes in wanted]
            found = _multiplied(builder, _picked(builder, found, left), _picked(builder, found, right))
        return _vector(builder, found)

    return Vector(len(like))(u, like), code


@intrinsic
def mirrored(typing_context, products, u):
    """The monomials of -u, given those of u."""
    sign = [(-1.0) ** len(axes) for axes in graded(u.size, _degree(u.size, products.size))]

    def code(context, builder, signature, args):
        signs = [ir.Constant(_DOUBLE, x) for x in sign]
        found = []
        for k, register in enumerate(_registers(builder, args[0])):
            part = signs[k * _WIDTH : (k + 1) * _WIDTH]
            part += [ir.Constant(_DOUBLE, 1.0)] * (register.type.count - len(part))
            found.append(builder.fmul(register, ir.Constant(register.type, part)))
        return _vector(builder, found)

    return products(products, u), code


# --- rows of arrays


def _cells(context: Any, builder: Any, signature: Any, args: Any, size: int) -> list[Any]:
    """Addresses of a row's parts, one for each register; the array is contiguous, its rows as long as the vector."""
    array = context.make_array(signature.args[0])(context, builder, value=args[0])
    k = context.cast(builder, args[1], signature.args[1], types.intp)
    first = builder.mul(k, context.get_constant(types.intp, size))
    cells = []
    for start in range(0, size, _WIDTH):
        cell = builder.gep(array.data, [builder.add(first, context.get_constant(types.intp, start))])
        part = ir.VectorType(array.data.type.pointee, min(size - start, _WIDTH))
        cells.append(builder.bitcast(cell, part.as_pointer()))
    return cells


def _loaded(builder: Any, cells: list[Any], align: int) -> list[Any]:
    found = []
    for cell in cells:
        register = builder.load(cell, align=align)
        if not isinstance(register.type.element, ir.DoubleType):
            register = builder.sitofp(register, ir.VectorType(_DOUBLE, register.type.count))
        size = register.type.count
        (width,) = _widths(size)
        lanes: list[int | None] = [*range(size)]
        nothing = ir.Constant(register.type, ir.Undefined)
        found.append(_shuffled(builder, register, nothing, lanes + [None] * (width - size)))
    return found


def _store(builder: Any, registers: list[Any], cells: list[Any], align: int) -> None:
    for register, cell in zip(registers, cells, strict=True):
        nothing = ir.Constant(register.type, ir.Undefined)
        lanes: list[int | None] = [*range(cell.type.pointee.count)]
        builder.store(_shuffled(builder, register, nothing, lanes), cell, align=align)


def _bytes(array: Any) -> int:
    """What a row is aligned to: one entry."""
    return int(array.dtype.bitwidth // 8)


@intrinsic
def row(typing_context, array_nc, k, like):
    """Row k as a vector of as many components as ``like``; whole numbers become doubles."""

    def code(context, builder, signature, args):
        cells = _cells(context, builder, signature, args, len(like))
        return _vector(builder, _loaded(builder, cells, _bytes(array_nc)))

    return Vector(len(like))(array_nc, k, like), code


@intrinsic
def put(typing_context, array_nc, k, vector):
    """Store a vector as row k."""

    def code(context, builder, signature, args):
        cells = _cells(context, builder, signature, args, vector.size)
        _store(builder, _registers(builder, args[2]), cells, _bytes(array_nc))
        return context.get_dummy_value()

    return types.none(array_nc, k, vector), code


@intrinsic
def add_to(typing_context, array_nc, k, vector):
    """Add a vector to row k."""

    def code(context, builder, signature, args):
        cells = _cells(context, builder, signature, args, vector.size)
        found = _loaded(builder, cells, _bytes(array_nc))
        _store(builder, _added(builder, found, _registers(builder, args[2])), cells, _bytes(array_nc))
        return context.get_dummy_value()

    return types.none(array_nc, k, vector), code
