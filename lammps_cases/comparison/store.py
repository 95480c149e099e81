"""A folder of named arrays that can be made again: the predictions of the reference, between one run and the next.

An entry is one file: its SHA-256, a header in JSON with name, type and shape of every array, the bytes of the arrays.
Files are written whole or not at all, so that any number of processes may share the folder; what is damaged counts as
absent. When the folder grows too large the entries that were not used for longest go first.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.cache import cache_folder
from lammps_cases.records.files import write_atomically

VARIABLE = "EOS_REF_PREDICTIONS"  # environment variable that names another folder
LIMIT = 2_000_000_000  # bytes
LARGEST = LIMIT // 20  # of an entry: one that is larger would cost many others their place, and memory to be packed
_HASH = hashlib.sha256().digest_size
_ALIGNED = 16

Arrays = Mapping[str, npt.NDArray[Any]]


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
    context : goes into every key: what all entries depend on beside what they are named by
    fresh : find nothing, so that everything is made and written anew
    """

    folder: Path
    context: str = ""
    fresh: bool = False

    def read(self, key: str) -> dict[str, npt.NDArray[Any]] | None:
        """Return the arrays of a key, read-only; None if there are none, or if they are damaged."""
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
                os.utime(path)  # in use: others go first
        return arrays

    def write(self, key: str, arrays: Arrays) -> None:
        """Keep the arrays of a key, unless they are very large; what is not written costs time later, nothing else."""
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
        """Remove the entries that were not used for longest, until the rest is within the limit."""
        files = _files(self.folder)
        excess = sum(size for _, size, _ in files) - limit
        for _, size, path in sorted(files):
            if excess <= 0:
                return
            with contextlib.suppress(OSError):  # another run removed it
                Path(path).unlink()
            excess -= size


def _files(folder: Path) -> list[tuple[int, int, str]]:
    """Return the time of last use, size and path of every file, those half-written included."""
    files = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                state = entry.stat()
                files.append((state.st_mtime_ns, state.st_size, entry.path))
    return files


def packed(name: str, arrays: Arrays) -> bytes:
    """Return the bytes of an entry of some name."""
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
    """Return the arrays of an entry, or None: it is damaged, or the entry of another name."""
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
