"""Registers that hold a short vector, in LLVM's terms: what `eos_ref.compiled.vectors` is made of.

A vector lies in registers of eight doubles; the last is as wide as the next power of two, as others do not stay in
registers from one iteration to the next. What its lanes hold beyond the vector has no meaning.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from llvmlite import ir

DOUBLE, LANE = ir.DoubleType(), ir.IntType(32)
WIDTH = 8  # doubles in the widest registers


def widths(size: int) -> list[int]:
    """Return the widths of a vector's registers; the last is a power of two, as no other stays in registers."""
    left = size % WIDTH
    return [WIDTH] * (size // WIDTH) + ([1 << (left - 1).bit_length()] if left else [])


def unpacked(builder: Any, vector: Any) -> list[Any]:
    """Return the registers of a vector."""
    return [builder.extract_value(vector, k) for k in range(len(vector.type.elements))]


def packed(builder: Any, registers: list[Any]) -> Any:
    """Return the vector of some registers."""
    vector = ir.Constant(ir.LiteralStructType([register.type for register in registers]), ir.Undefined)
    for k, register in enumerate(registers):
        vector = builder.insert_value(vector, register, k)
    return vector


def constants(numbers: list[float]) -> list[Any]:
    """Return registers of constants."""
    registers = []
    for k, width in enumerate(widths(len(numbers))):
        part = numbers[k * WIDTH : (k + 1) * WIDTH]
        registers.append(ir.Constant(ir.VectorType(DOUBLE, width), part + [0.0] * (width - len(part))))
    return registers


# --- lanes


def shuffled(builder: Any, register: Any, other: Any, lanes: list[int | None]) -> Any:
    """Pick lanes of a register, those of another counted on; None: of no meaning, the first of the other."""
    mask = [ir.Constant(LANE, register.type.count if lane is None else lane) for lane in lanes]
    return builder.shuffle_vector(register, other, ir.Constant(ir.VectorType(LANE, len(mask)), mask))


def resized(builder: Any, register: Any, size: int) -> Any:
    """Return the first lanes of a register, or the register with lanes of no meaning."""
    kept = min(size, register.type.count)
    lanes: list[int | None] = [*range(kept)]
    return shuffled(builder, register, ir.Constant(register.type, ir.Undefined), lanes + [None] * (size - kept))


def picked(builder: Any, registers: list[Any], places: list[int]) -> list[Any]:
    """Return registers of the components at some places."""
    result, start = [], 0
    for width in widths(len(places)):
        wanted = dict(enumerate(places[start : start + width]))
        parts: Any = None
        for k, register in enumerate(registers):
            lanes = {lane: place - k * WIDTH for lane, place in wanted.items() if place // WIDTH == k}
            if not lanes:
                continue
            nothing = ir.Constant(register.type, ir.Undefined)
            part = shuffled(builder, register, nothing, [lanes.get(lane) for lane in range(width)])
            choice: list[int | None] = [lane + width * (lane in lanes) for lane in range(width)]
            parts = part if parts is None else shuffled(builder, parts, part, choice)
        result.append(parts)
        start += width
    return result


# --- arithmetic


def added(builder: Any, a: list[Any], b: list[Any]) -> list[Any]:
    """Add lane by lane."""
    return [builder.fadd(x, y) for x, y in zip(a, b, strict=True)]


def multiplied(builder: Any, a: list[Any], b: list[Any]) -> list[Any]:
    """Multiply lane by lane."""
    return [builder.fmul(x, y) for x, y in zip(a, b, strict=True)]


def sum_of_pieces(builder: Any, registers: list[Any], pieces: list[list[int]]) -> list[Any]:
    """Sum the vectors picked from one, from the first on."""
    total = picked(builder, registers, pieces[0])
    for piece in pieces[1:]:
        total = added(builder, total, picked(builder, registers, piece))
    return total


# --- memory


class Place(NamedTuple):
    """Address of a part of a row, and the type of what lies there: a pointer need not know it."""

    address: Any
    part: ir.VectorType


def places(builder: Any, data: Any, first: Any, element: ir.Type, size: int) -> list[Place]:
    """Return where a row's parts lie, one for each register; ``first`` counts the elements before the row."""
    parts = []
    for start in range(0, size, WIDTH):
        part = ir.VectorType(element, min(size - start, WIDTH))
        cell = builder.gep(data, [builder.add(first, first.type(start))], source_etype=element)
        parts.append(Place(builder.bitcast(cell, part.as_pointer()), part))
    return parts


def loaded(builder: Any, row: list[Place], align: int) -> list[Any]:
    """Return the registers of a row; whole numbers become doubles."""
    registers = []
    for address, part in row:
        register = builder.load(address, align=align, typ=part)
        if not isinstance(part.element, ir.DoubleType):
            register = builder.sitofp(register, ir.VectorType(DOUBLE, part.count))
        registers.append(resized(builder, register, *widths(part.count)))
    return registers


def store(builder: Any, registers: list[Any], row: list[Place], align: int) -> None:
    """Write a row."""
    for register, (address, part) in zip(registers, row, strict=True):
        builder.store(resized(builder, register, part.count), address, align=align)
