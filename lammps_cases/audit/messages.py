"""What the process that runs a deck may send: messages of `lammps_cases.audit.options`, made of plain data.

The deck may have taken that process over: a pickle could then name anything that is to be called here.
"""

from __future__ import annotations

import io
import pickle
from multiprocessing.connection import Connection
from typing import Any

from pydantic import TypeAdapter, ValidationError

from eos_ref.errors import InputError
from lammps_cases.audit.options import CommandPlace, DeckEnd, DeckSetups, EngineIdentity, RunFacts, SampleRows
from lammps_cases.engine.session import EngineMissing

LARGEST = 2**32  # bytes of a message: the arrays of 1e7 atoms
_RECORDS = ("lammps_cases.records.case_parts", "lammps_cases.records.run_record")
MODULES = ("lammps_cases.audit.options", *_RECORDS)  # whose own classes are data
_NUMPY = (("multiarray", "_reconstruct"), ("multiarray", "scalar"), ("numeric", "_frombuffer"))
NAMES = {
    *{("eos_ref.errors", name) for name in ("InputError", "InputErrors")},
    ("lammps_cases.engine.session", "EngineMissing"),
    *{("numpy", name) for name in ("ndarray", "dtype")},
    *{("builtins", name) for name in ("set", "frozenset")},
    ("_codecs", "encode"),
    *((f"numpy._core.{module}", name) for module, name in _NUMPY),
    *((f"numpy.core.{module}", name) for module, name in _NUMPY),
}

KINDS: dict[type, TypeAdapter[Any]] = {
    kind: TypeAdapter(kind) for kind in (EngineIdentity, CommandPlace, RunFacts, SampleRows, DeckSetups, DeckEnd)
}


class Foreign(ValueError):
    """No message of an audit."""


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in NAMES:
            return super().find_class(module, name)
        if module in MODULES and "." not in name:
            cls = super().find_class(module, name)
            if isinstance(cls, type) and cls.__module__ == module:
                return cls
        raise Foreign(f"{module}.{name}"[:100])


def received(connection: Connection) -> object:
    """Wait for a message, and return it.

    Raises
    ------
    Foreign
    EOFError
        The other side has ended.
    """
    try:
        message = _Reader(io.BytesIO(connection.recv_bytes(LARGEST))).load()
    except (Foreign, EOFError):
        raise
    except Exception as error:  # whatever damaged bytes make of it
        raise Foreign(type(error).__name__) from None
    if isinstance(message, InputError | EngineMissing):
        return message
    if type(message) not in KINDS:
        raise Foreign(type(message).__name__)
    try:
        return KINDS[type(message)].validate_python(vars(message))
    except ValidationError as error:
        raise Foreign(f"{type(message).__name__}: {error.errors()[0]['msg']}"[:100]) from None
