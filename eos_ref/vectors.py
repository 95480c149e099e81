"""Short vectors in registers, for compiled loops: tuples whose length, a dimension, is known when a loop is compiled.

A row of a two-dimensional array becomes a tuple and back; sums and products of tuples are written out component by
component, so that loops over axes leave no trace. Which row length is meant is said by a tuple of that length
(``like``). Nothing here is a formula of the model. All functions exist in compiled code only.
"""

# mypy: disable-error-code="untyped-decorator,no-untyped-def"

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import Any

from numba import types
from numba.extending import intrinsic


def graded(dimension: int, degree: int) -> list[tuple[int, ...]]:
    """Monomials up to a degree, each as the axes that it multiplies, by degree: (), (0,), (1,), (0, 0), (0, 1), ..."""
    return [axes for k in range(degree + 1) for axes in combinations_with_replacement(range(dimension), k)]


def _parts(builder: Any, vector: Any, size: int) -> list[Any]:
    return [builder.extract_value(vector, k) for k in range(size)]


def _componentwise(operation: str) -> Any:
    @intrinsic
    def function(typing_context, a, b):
        def code(context, builder, signature, args):
            pairs = zip(_parts(builder, args[0], len(a)), _parts(builder, args[1], len(a)), strict=True)
            found = [getattr(builder, operation)(x, y) for x, y in pairs]
            return context.make_tuple(builder, signature.return_type, found)

        return a(a, b), code

    return function


plus = _componentwise("fadd")
minus = _componentwise("fsub")
times = _componentwise("fmul")


def _sum_of_products(builder: Any, a: list[Any], b: list[Any]) -> Any:
    total = builder.fmul(a[0], b[0])
    for x, y in zip(a[1:], b[1:], strict=True):
        total = builder.fadd(total, builder.fmul(x, y))
    return total


@intrinsic
def dot(typing_context, a, b):
    """Scalar product, summed from the first component on."""

    def code(context, builder, signature, args):
        return _sum_of_products(builder, _parts(builder, args[0], len(a)), _parts(builder, args[1], len(a)))

    return types.float64(a, b), code


@intrinsic
def scaled(typing_context, factor, a):
    """A number times a vector."""

    def code(context, builder, signature, args):
        found = [builder.fmul(args[0], x) for x in _parts(builder, args[1], len(a))]
        return context.make_tuple(builder, signature.return_type, found)

    return a(types.float64, a), code


@intrinsic
def outer(typing_context, a, b):
    """All products a[k]*b[l], the second index running fastest."""
    size = len(a) * len(b)

    def code(context, builder, signature, args):
        right = _parts(builder, args[1], len(b))
        found = [builder.fmul(x, y) for x in _parts(builder, args[0], len(a)) for y in right]
        return context.make_tuple(builder, signature.return_type, found)

    return types.UniTuple(types.float64, size)(a, b), code


@intrinsic
def matrix_times(typing_context, matrix, a):
    """Matrix, given row after row, times a vector."""
    rows, size = len(matrix) // len(a), len(a)

    def code(context, builder, signature, args):
        m, x = _parts(builder, args[0], rows * size), _parts(builder, args[1], size)
        found = [_sum_of_products(builder, m[k * size : (k + 1) * size], x) for k in range(rows)]
        return context.make_tuple(builder, signature.return_type, found)

    return types.UniTuple(types.float64, rows)(matrix, a), code


def _degree(dimension: int, count: int) -> int:
    return next(k for k in range(9) if len(graded(dimension, k)) == count)


@intrinsic
def monomials(typing_context, u, like):
    """Products of components in the order of `graded`, as many as ``like`` has entries."""
    axes = graded(len(u), _degree(len(u), len(like)))

    def code(context, builder, signature, args):
        x = _parts(builder, args[0], len(u))
        known: dict[tuple[int, ...], Any] = {(): context.get_constant(types.float64, 1.0)}
        known |= {(a,): x[a] for a in range(len(u))}
        for product in axes:
            if product not in known:
                known[product] = builder.fmul(known[product[:-1]], x[product[-1]])
        return context.make_tuple(builder, signature.return_type, [known[product] for product in axes])

    return like(u, like), code


@intrinsic
def mirrored(typing_context, products, u):
    """The monomials of -u, given those of u."""
    axes = graded(len(u), _degree(len(u), len(products)))

    def code(context, builder, signature, args):
        parts = zip(axes, _parts(builder, args[0], len(axes)), strict=True)
        found = [builder.fneg(x) if len(product) % 2 else x for product, x in parts]
        return context.make_tuple(builder, signature.return_type, found)

    return products(products, u), code


def _cells(context: Any, builder: Any, signature: Any, args: Any, size: int) -> list[Any]:
    """Addresses of a row's entries; the array is contiguous, its rows as long as the vector."""
    array = context.make_array(signature.args[0])(context, builder, value=args[0])
    k = context.cast(builder, args[1], signature.args[1], types.intp)
    start = builder.mul(k, context.get_constant(types.intp, size))
    return [builder.gep(array.data, [builder.add(start, context.get_constant(types.intp, c))]) for c in range(size)]


@intrinsic
def row(typing_context, array_nc, k, like):
    """Row k as a vector of as many components as ``like``; whole numbers become doubles."""

    def code(context, builder, signature, args):
        cells = [builder.load(cell) for cell in _cells(context, builder, signature, args, len(like))]
        found = [context.cast(builder, cell, array_nc.dtype, types.float64) for cell in cells]
        return context.make_tuple(builder, signature.return_type, found)

    return types.UniTuple(types.float64, len(like))(array_nc, k, like), code


@intrinsic
def put(typing_context, array_nc, k, vector):
    """Store a vector as row k."""

    def code(context, builder, signature, args):
        cells = _cells(context, builder, signature, args, len(vector))
        for cell, x in zip(cells, _parts(builder, args[2], len(vector)), strict=True):
            builder.store(x, cell)
        return context.get_dummy_value()

    return types.none(array_nc, k, vector), code


@intrinsic
def add_to(typing_context, array_nc, k, vector):
    """Add a vector to row k."""

    def code(context, builder, signature, args):
        cells = _cells(context, builder, signature, args, len(vector))
        # All loads before all stores: the compiler may then use one wide register.
        found = [builder.load(cell) for cell in cells]
        found = [builder.fadd(y, x) for y, x in zip(found, _parts(builder, args[2], len(vector)), strict=True)]
        for cell, x in zip(cells, found, strict=True):
            builder.store(x, cell)
        return context.get_dummy_value()

    return types.none(array_nc, k, vector), code
