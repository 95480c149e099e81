"""Rows of arrays in registers, accessed through opaque pointers."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np
import pytest
from llvmlite import ir

from eos_ref.compiled import registers

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]


def copies_row(element: ir.Type, size: int) -> str:
    """Text of a function that stores row 2 of one array as doubles into row 1 of another."""
    module = ir.Module()
    pointer = ir.PointerType()
    assert pointer.is_opaque
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [pointer, pointer]), "copies_row")
    builder = ir.IRBuilder(function.append_basic_block())
    source, target = function.args
    rows = [ir.Constant(ir.IntType(64), k * size) for k in (2, 1)]
    loaded = registers.loaded(builder, registers.places(builder, source, rows[0], element, size), 1)
    registers.store(builder, loaded, registers.places(builder, target, rows[1], registers.DOUBLE, size), 1)
    builder.ret_void()
    return str(module)


@pytest.mark.parametrize("size", [1, 2, 3, 9, 16])
@pytest.mark.parametrize(
    ("element", "number"), [(registers.DOUBLE, np.float64), (ir.IntType(16), np.int16)], ids=["double", "int16"]
)
def test_rows_are_loaded_and_stored_through_opaque_pointers(element: ir.Type, number: Any, size: int) -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_assembly(copies_row(element, size))
    module.verify()
    machine = llvm.Target.from_default_triple().create_target_machine()
    source_nc, target_nc = np.arange(4 * size, dtype=number).reshape(4, size), np.full((3, size), -7.0)
    with llvm.create_mcjit_compiler(module, machine) as engine:
        engine.finalize_object()
        call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(engine.get_function_address("copies_row"))
        call(source_nc.ctypes.data, target_nc.ctypes.data)
    assert np.array_equal(target_nc, [np.full(size, -7.0), source_nc[2], np.full(size, -7.0)])


def test_vectors_compile_with_typed_pointers_off() -> None:
    """The switch of llvmlite under which pointers are written without a type, read when it is imported."""
    code = (
        "import llvmlite\n"
        "from tests.eos_ref.compiled.test_vectors import test_arithmetic, test_whole_numbers_and_tuples\n"
        "assert not llvmlite.ir_layer_typed_pointers_enabled\n"
        "test_arithmetic(9)\n"
        "test_whole_numbers_and_tuples(3)\n"
    )
    environment = {**os.environ, "LLVMLITE_ENABLE_IR_LAYER_TYPED_POINTERS": "0", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
