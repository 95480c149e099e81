"""Files: written atomically, read up to a size."""

from __future__ import annotations

import csv
import io
import lzma
import os
import stat
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eos_ref.errors import InputError

DATA = Path(__file__).parents[1] / "data"  # what is shipped: cases, claims, probes, templates, measured curves
MIB = 2**20
LARGEST = 4096 * MIB  # of a file of arrays, unpacked
# Errors of zipfile and of numpy's reader of headers for a damaged archive.
DAMAGED: tuple[type[Exception], ...] = (
    *(ValueError, EOFError, OSError, KeyError, IndexError, TypeError, NotImplementedError, RuntimeError, SyntaxError),
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
)
_PREFIX = 10  # bytes before the header of an .npy file of version 1: magic, version, length of the header


def write_atomically(path: Path, content: bytes | str) -> None:
    """Write a file so that a reader, or a kill at any moment, finds the old content or the new one, never a part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, content)


def replace_file(path: Path, content: bytes | str) -> None:
    """Do the same in a folder that exists."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
        Path(name).chmod(0o644)
        Path(name).replace(path)
    except BaseException as error:
        Path(name).unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename is None:
            error.filename = str(path)  # the system does not name the disk that is full
        raise


def read_bytes(path: Path, what: str, most: int) -> bytes:
    """Return the content of a file; a fifo, a device or a file without end neither hangs nor fills the memory.

    Parameters
    ----------
    what : str
        The name of such a file in complaints.
    most : int
        Bytes that it may have.

    Raises
    ------
    InputError
        It cannot be read, is not a regular file, or is larger.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # of a fifo, without waiting for a writer
        with os.fdopen(handle, "rb") as file:
            if not stat.S_ISREG(os.fstat(handle).st_mode):
                raise InputError(what, "must be a regular file", where=str(path))
            content = file.read(most + 1)
    except OSError as error:
        raise InputError(what, f"cannot be read: {error.strerror}", where=str(path)) from None
    except ValueError:  # a path with a null character
        raise InputError(what, "cannot be read: no name of a file", where=str(path)) from None
    if len(content) > most:
        raise InputError(what, f"must be at most {most / MIB:g} MiB", where=str(path))
    return content


def read_text(path: Path, what: str, most: int) -> str:
    """Return the text of a file; raises as `read_bytes`, and if it is not UTF-8."""
    try:
        return read_bytes(path, what, most).decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(what, "must be UTF-8 text", where=str(path)) from None


def arrays_files(fields: Path, case: str) -> list[Path]:
    """Return the files that the arrays of a case may lie in; see `lammps_cases.verdict.case_arrays`."""
    return [fields / f"{case}{of}.npz" for of in ("", "@page", "@steps")]


def write_arrays(path: Path, arrays: Mapping[str, Any], compressed: bool = False) -> None:
    """Write per-atom arrays as an npz file, atomically and with the same bytes on every run."""
    buffer = io.BytesIO()
    method = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name in sorted(arrays):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                member.write(_npy(np.asarray(arrays[name])))
    write_atomically(path, buffer.getvalue())


def _npy(array: NDArray[Any]) -> bytes:
    """Return an array as numpy writes it; the few headers of a run are made once."""
    if array.dtype.hasobject:
        raise ValueError("Python objects are no numbers")
    of: Any = np.lib.format.header_data_from_array_1_0(array)
    order: Any = "F" if of["fortran_order"] else "C"
    return _header_bytes(of["shape"], of["fortran_order"], of["descr"]) + array.tobytes(order)


@lru_cache(maxsize=256)
def _header_bytes(shape: tuple[int, ...], fortran: bool, descr: str) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": descr, "fortran_order": fortran, "shape": shape})
    return stream.getvalue()


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read all arrays of an npz file that `write_arrays` wrote; they are read-only.

    As np.load, in half the time: that parses the header of every array as Python source, and a run has a thousand
    arrays with a dozen different headers.

    Raises
    ------
    InputError
        The file cannot be read, or is damaged.
    """
    arrays = {}
    try:
        with zipfile.ZipFile(io.BytesIO(read_bytes(path, "per-atom arrays", LARGEST))) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
            if unpacked > LARGEST:  # a member never unpacks to more than its stated size
                most = LARGEST / MIB
                raise ValueError(f"unpacked they have {unpacked / MIB:.0f} MiB, more than {most:g}")
            for name in archive.namelist():
                raw = archive.read(name)
                start = _PREFIX + int.from_bytes(raw[8:_PREFIX], "little")
                shape, fortran, dtype = _header(raw[:start])
                values = np.frombuffer(raw, dtype, offset=start)
                arrays[name.removesuffix(".npy")] = values.reshape(shape, order="F" if fortran else "C")
    except InputError:
        raise
    except DAMAGED as error:
        raise InputError("per-atom arrays", f"are damaged: {error}", where=str(path)) from None
    return arrays


@lru_cache(maxsize=256)
def _header(raw: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    stream = io.BytesIO(raw)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("not an array of npy format 1.0")
    return np.lib.format.read_array_header_1_0(stream)


def csv_text(rows: Iterable[Iterable[object]], delimiter: str = ",") -> str:
    """Return rows as the lines of a CSV file."""
    text = io.StringIO()
    csv.writer(text, delimiter=delimiter, lineterminator="\n").writerows(rows)
    return text.getvalue()
