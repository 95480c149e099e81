"""The store: predictions of the reference and judgements, kept between runs.

An entry is found by its key, the hash of all its input to the last bit, and by the context of
its store: the sources, and the machine and libraries that round. `current` decides whether a process may use a store.

An entry is one file: its SHA-256, a header in JSON with name, type and shape of every array, the bytes of the arrays.
Files are written atomically, so that any number of processes may share the folder; damaged files count as
absent. When the folder grows too large, the least recently used entries are removed first.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import math
import os
import platform
from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.cache import cache_folder
from lammps_cases.records.files import write_atomically
from lammps_cases.records.measure import cpuinfo

VARIABLE = "EOS_REF_PREDICTIONS"  # environment variable that names another folder
LIMIT = 2_000_000_000  # bytes
LARGEST = LIMIT // 20  # of an entry: a larger one would displace many others, and need memory to be packed
ROOT = Path(__file__).parents[2]
# The packages here that predictions depend on, in addition to all of eos_ref. A test follows the imports.
ROOMS = ("records", "comparison", "findings", "verdict")
CATALOGUE = ("scene/changes.py", "data/changes.yaml")  # the mistakes whose names are kept with predictions
CASES = ROOT / "lammps_cases" / "data" / "cases"  # not part of the code: an entry depends on its case alone
LIBRARIES = ("llvmlite", "numba", "numpy", "python-flint", "scipy")
INSTRUCTIONS = ("avx", "avx2", "fma", "avx512f", "asimd", "sve")  # those for which libraries have special code
SWITCHES = ("GLIBC_TUNABLES", "NPY_", "NUMBA_", "OPENBLAS_")  # environment variables that may change how code rounds
_HASH = hashlib.sha256().digest_size
_ALIGNED = 16
_PLAIN = frozenset((type(None), bool, int, str))

Arrays = Mapping[str, npt.NDArray[Any]]


class Unnamed(TypeError):
    """A value that a key cannot name: its source is not part of the context."""


def fingerprint(*parts: object) -> str:
    """Return the SHA-256 of values, arrays, dataclasses, and sequences and dictionaries of them, to the last bit.

    Raises
    ------
    Unnamed
        A value of any other kind, or a class that is not of the reference.
    """
    return hashlib.sha256(_text(parts).encode()).hexdigest()


def _text(part: object) -> str:
    """Return all that a key depends on as text, arrays as their hashes."""
    words: list[str] = []
    _spell(part, words)
    return "".join(words)


def _spell(part: Any, words: list[str]) -> None:
    # By frequency: a problem has a hundred values, and a case some ten keys.
    kind = part.__class__
    if kind in _PLAIN:
        words.append(f"{kind.__name__} {part!r};")
    elif kind is float:
        words.append(f"float {part.hex()};")
    elif isinstance(part, (tuple, list)):
        words.append(f"sequence {len(part)};")
        for each in part:
            _spell(each, words)
    elif isinstance(part, dict) and all(isinstance(name, str) for name in part):
        words.append(f"mapping {len(part)};")
        for name in sorted(part):
            _spell((name, part[name]), words)
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
    """Return the text of a dataclass without its values, and the names of its fields."""
    names = tuple(each.name for each in fields(kind))
    return _text((kind.__qualname__, *names)), names


def _named(cls: type) -> tuple[object, ...]:
    """Return the module, name and settings of a class whose source the context holds; raise for any other."""
    package, _, module = cls.__module__.partition(".")
    if (
        package != "eos_ref" and (package != "lammps_cases" or module.partition(".")[0] not in ROOMS)
    ) or "<" in cls.__qualname__:
        raise Unnamed(f"{cls.__module__}.{cls.__qualname__} is not part of the reference")
    plain = {k: v for k, v in vars(cls).items() if isinstance(v, bool | int | float | str | tuple) and k[:2] != "__"}
    return (cls.__module__, cls.__qualname__, *sorted(plain.items()))


def hashed(root: Path) -> list[Path]:
    """Return all files whose bytes determine predictions."""
    folders = [root / "eos_ref", *(root / "lammps_cases" / room for room in ROOMS)]
    catalogue = (root / "lammps_cases" / name for name in CATALOGUE)
    modules = [path for folder in folders for path in sorted(folder.rglob("*.py"))]
    return modules + [path for path in catalogue if path.is_file()]


def context(root: Path = ROOT) -> str:
    """Return the SHA-256 of all that predictions depend on: sources, libraries, processor, switches."""
    simd: Any = np.show_config(mode="dicts")
    machine = (platform.machine(), processor(), str(simd["SIMD Extensions"]))
    switches = sorted(f"{k}={v}" for k, v in os.environ.items() if k.startswith(SWITCHES))
    python = platform.python_version()
    return fingerprint(_digests(root, hashed(root)), python, *machine, *map(_version, LIBRARIES), switches)


def code(predictions: str = "") -> str:
    """Return the SHA-256 of all that judgements depend on: all code and data, and the context of predictions."""
    files = list[Path]()
    for folder, below, names in (found for package in ("eos_ref", "lammps_cases") for found in os.walk(ROOT / package)):
        below[:] = sorted(name for name in below if name != "__pycache__" and Path(folder, name) != CASES)
        files += (Path(folder, name) for name in sorted(names))
    return fingerprint(predictions or context(), _digests(ROOT, files))


def digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _digests(root: Path, files: list[Path]) -> list[tuple[str, str]]:
    return [(path.relative_to(root).as_posix(), digest(path)) for path in files]


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return ""


def processor() -> str:
    """Return the processor as far as it determines the instructions used, and the C library with its functions."""
    facts = cpuinfo()
    flags = set(facts.get("flags", facts.get("Features", "")).split())
    try:
        libc = os.confstr("CS_GNU_LIBC_VERSION") or "" if facts else ""
    except (OSError, ValueError):
        libc = ""
    name = facts.get("model name", platform.machine())
    return ", ".join(filter(None, (name, " ".join(i for i in INSTRUCTIONS if i in flags), libc)))


def store_folder() -> Path:
    """Return the folder of the store: that of `VARIABLE`, or in the user's cache."""
    named = os.environ.get(VARIABLE)
    return Path(named) if named else cache_folder("predictions")


@dataclass(frozen=True)
class Store:
    """Arrays by key.

    Attributes
    ----------
    folder : where the entries lie
    context : part of every key: what all entries depend on, in addition to their own keys
    fresh : find nothing, so that all entries are made and written again
    """

    folder: Path
    context: str = ""
    fresh: bool = False

    def read(self, key: str) -> dict[str, npt.NDArray[Any]] | None:
        """Return the arrays of a key, read-only; None if absent or damaged."""
        if self.fresh:
            return None
        path = self._path(key)
        try:
            content = path.read_bytes()
        except OSError:
            return None
        arrays = unpacked(path.name, content)
        if arrays is not None:
            with contextlib.suppress(OSError):
                os.utime(path)  # in use: others are removed first
        return arrays

    def write(self, key: str, arrays: Arrays) -> None:
        """Keep the arrays of a key, unless they are very large; missing entries only cost time later."""
        if sum(array.nbytes for array in arrays.values()) > LARGEST:
            return
        path = self._path(key)
        with contextlib.suppress(OSError):
            write_atomically(path, packed(path.name, arrays))

    def _path(self, key: str) -> Path:
        return self.folder / hashlib.sha256(f"{self.context}/{key}".encode()).hexdigest()

    def size(self) -> tuple[int, int]:
        """Return the number of entries, and their bytes."""
        files = _files(self.folder)
        return len(files), sum(size for _, size, _ in files)

    def trim(self, limit: int = LIMIT) -> None:
        """Remove the least recently used entries until the rest is within the limit."""
        files = _files(self.folder)
        excess = sum(size for _, size, _ in files) - limit
        for _, size, path in sorted(files):
            if excess <= 0:
                return
            with contextlib.suppress(OSError):  # another run removed it
                Path(path).unlink()
            excess -= size


def open_store(fresh: bool = False) -> Store:
    """Return the user's store for the current reference."""
    return Store(store_folder(), context(), fresh)


@functools.cache
def current(store: Store) -> bool:
    """Return whether a store belongs to the code of this process: no other store is read or written.

    A worker that starts after an edit does not have the code of its run; one that started before may import
    the rest of it later.
    """
    now = context()
    return store.context == now or store.context == code(now)


def _files(folder: Path) -> list[tuple[int, int, str]]:
    """Return the time of last use, size and path of every file, including partly written ones."""
    files = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                state = entry.stat()
                files.append((state.st_mtime_ns, state.st_size, entry.path))
    return files


def packed(name: str, arrays: Arrays) -> bytes:
    """Return the bytes of an entry with a name."""
    described, parts = [], []
    for key, array in arrays.items():
        contiguous = np.ascontiguousarray(array)
        if contiguous.dtype.hasobject:
            raise TypeError(f"{key} holds Python objects")
        described.append((key, contiguous.dtype.str, array.shape))
        parts.append(_padded(contiguous.tobytes()))
    header = _padded(json.dumps(described).encode(), b" ")
    body = b"".join((_padded(str(len(header)).encode(), b" "), header, *parts))
    return hashlib.sha256(name.encode() + body).digest() + body


def unpacked(name: str, content: bytes) -> dict[str, npt.NDArray[Any]] | None:
    """Return the arrays of an entry; None if it is damaged or has another name."""
    body = memoryview(content)[_HASH:]
    digest = hashlib.sha256(name.encode())
    digest.update(body)
    if digest.digest() != content[:_HASH]:
        return None
    start = _HASH + _ALIGNED
    end = start + int(content[_HASH:start])
    arrays = {}
    for key, kind, shape in json.loads(content[start:end]):
        dtype, count = np.dtype(kind), math.prod(shape)
        arrays[key] = np.frombuffer(content, dtype, count, end).reshape(shape)
        end += -(-count * dtype.itemsize // _ALIGNED) * _ALIGNED
    return arrays


def _padded(content: bytes, fill: bytes = b"\0") -> bytes:
    return content + fill * (-len(content) % _ALIGNED)
