"""Keys of predictions: everything that a prediction depends on, in one hash, to the last bit.

Beside the problem itself these are the sources of the reference, and the machine and libraries that round.
"""

from __future__ import annotations

import functools
import hashlib
import os
import platform
from abc import ABC
from dataclasses import fields, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from lammps_cases.comparison.store import Store, store_folder
from lammps_cases.records.measure import cpuinfo

# The rooms of this package that predictions go through; with them all of eos_ref. A test follows the imports.
ROOMS = ("records", "rules", "comparison", "findings", "verdict")
LIBRARIES = ("llvmlite", "numba", "numpy", "python-flint", "scipy")
INSTRUCTIONS = ("avx", "avx2", "fma", "avx512f", "asimd", "sve")  # those for which libraries have code of its own
_PLAIN = frozenset((type(None), bool, int, str))
SWITCHES = ("GLIBC_TUNABLES", "NPY_", "NUMBA_", "OPENBLAS_")  # environment variables that may change how code rounds


class Unnamed(TypeError):
    """Something that a key cannot name: its source is not part of the context."""


def fingerprint(*parts: object) -> str:
    """Return the SHA-256 of values, arrays and dataclasses, to the last bit.

    Raises
    ------
    Unnamed
        A value of any other kind, or a class that is not of the reference.
    """
    return hashlib.sha256(_text(parts).encode()).hexdigest()


def _text(part: object) -> str:
    """Return everything that a key depends on as text, in which an array is its hash."""
    words: list[str] = []
    _spell(part, words)
    return "".join(words)


def _spell(part: Any, words: list[str]) -> None:
    # By what there is most of: a problem has a hundred values, and a case some ten keys.
    kind = part.__class__
    if kind in _PLAIN:
        words.append(f"{kind.__name__} {part!r};")
    elif kind is float:
        words.append(f"float {part.hex()};")
    elif isinstance(part, (tuple, list)):
        words.append(f"sequence {len(part)};")
        for each in part:
            _spell(each, words)
    elif isinstance(part, np.ndarray) and not part.dtype.hasobject:
        hashed = hashlib.sha256(np.ascontiguousarray(part).tobytes()).hexdigest()
        words.append(f"array {part.dtype.str} {part.shape} {hashed};")
    elif isinstance(part, np.generic):
        _spell(part.item(), words)  # numpy's float64 is a float
    elif isinstance(part, type):
        for base in part.__mro__:
            if base not in (object, ABC):
                _spell(_named(base), words)
    elif is_dataclass(part):
        text, names = _of_dataclass(kind)
        words.append(text)
        for name in names:
            _spell(getattr(part, name), words)
    else:
        raise Unnamed(f"no key can hold a {type(part).__name__}")


@functools.cache
def _of_dataclass(kind: Any) -> tuple[str, tuple[str, ...]]:
    """Return the text of a dataclass beside its values, and the names of its fields."""
    names = tuple(each.name for each in fields(kind))
    return _text((kind.__qualname__, *names)), names


def _named(cls: type) -> tuple[object, ...]:
    """Return the module, name and settings of a class whose source the context holds; of no other."""
    package, _, module = cls.__module__.partition(".")
    if (
        package != "eos_ref" and (package != "lammps_cases" or module.partition(".")[0] not in ROOMS)
    ) or "<" in cls.__qualname__:
        raise Unnamed(f"{cls.__module__}.{cls.__qualname__} is not part of the reference")
    plain = {k: v for k, v in vars(cls).items() if isinstance(v, bool | int | float | str | tuple) and k[:2] != "__"}
    return (cls.__module__, cls.__qualname__, *sorted(plain.items()))


def hashed(root: Path) -> list[Path]:
    """Return all files whose bytes decide what is predicted."""
    folders = [root / "eos_ref", *(root / "lammps_cases" / room for room in ROOMS)]
    return [path for folder in folders for path in sorted(folder.rglob("*.py"))]


def context(root: Path = Path(__file__).parents[2]) -> str:
    """Return the SHA-256 of all that predictions depend on: sources, libraries, processor, switches."""
    sources = [
        (path.relative_to(root).as_posix(), hashlib.sha256(path.read_bytes()).hexdigest()) for path in hashed(root)
    ]
    simd: Any = np.show_config(mode="dicts")
    machine = (platform.machine(), processor(), str(simd["SIMD Extensions"]))
    switches = sorted(f"{k}={v}" for k, v in os.environ.items() if k.startswith(SWITCHES))
    return fingerprint(sources, platform.python_version(), *machine, *map(_version, LIBRARIES), switches)


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return ""


def processor() -> str:
    """Return the processor as far as it decides which instructions are used, and the C library with its functions."""
    facts = cpuinfo()
    flags = set(facts.get("flags", facts.get("Features", "")).split())
    try:
        libc = os.confstr("CS_GNU_LIBC_VERSION") or "" if facts else ""
    except (OSError, ValueError):
        libc = ""
    name = facts.get("model name", platform.machine())
    return ", ".join(filter(None, (name, " ".join(i for i in INSTRUCTIONS if i in flags), libc)))


def open_store(fresh: bool = False) -> Store:
    """Return the user's store, for the reference as it is."""
    return Store(store_folder(), context(), fresh)


@functools.cache
def current(store: Store) -> bool:
    """Return whether a store's context is that of this process: sources may have changed since the store was opened."""
    return store.context == context()
