"""Containment with limits of a process that takes strangers' input, by Landlock, or else by bubblewrap.

`Reach` lists what the process may read and write. It cannot start programs or processes, open sockets or signal
other processes. Linux' Landlock restricts it to its files (kernel 5.13 or later, no root needed); a filter of system
calls denies it, root or not, what Landlock does not govern. Both hold until the process ends, for all that it loads.
"""

from __future__ import annotations

import ctypes
import functools
import os
import platform
import resource
import shutil
import signal
import struct
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Means = Literal["landlock", "bubblewrap", "none"]

# --- reachable files

SYSTEM = ("/usr/lib", "/usr/lib64", "/usr/libexec", "/lib", "/lib64", "/etc/ld.so.cache", "/etc/ld.so.conf.d")
TIME_ZONES = ("/etc/localtime", "/usr/share/zoneinfo")
MACHINE = ("/sys", "/proc", "/dev/urandom")  # read by MPI when it starts
DEVICES = ("/dev/null",)
SHARED_MEMORY = "/dev/shm"
PACKAGES = Path(__file__).parents[2]


@dataclass(frozen=True)
class Reach:
    """Files and folders, with all below them, that a process may read, and those that it may also write."""

    read: tuple[str, ...]
    write: tuple[str, ...]


def installation(folders: Iterable[Path] = ()) -> tuple[str, ...]:
    """Return the folders of this Python, its packages and its libraries, with those of an engine."""
    own = [PACKAGES / "eos_ref", PACKAGES / "lammps_cases"]
    own += [Path(place) for place in sys.path if place.endswith(("site-packages", "dist-packages"))]
    for prefix in {sys.prefix, sys.base_prefix, os.path.realpath(sys.base_prefix)}:
        own += [Path(prefix) / name for name in ("lib", "lib64", "pyvenv.cfg")]
    own += [Path(sys.executable), Path(sys.executable).resolve(), *folders]
    return tuple(dict.fromkeys([*SYSTEM, *TIME_ZONES, *(str(path.absolute()) for path in own)]))


def loaded_libraries() -> set[Path]:
    """Return the folders of the shared libraries of this process."""
    lines = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace").splitlines()
    files = {line.split(maxsplit=5)[5] for line in lines if line.count("/")}
    return {Path(file).parent for file in files if ".so" in Path(file).name and Path(file).is_file()}


# --- available means

_LIBC = ctypes.CDLL(None, use_errno=True)
_CREATE, _ADD, _RESTRICT = 444, 445, 446  # landlock_create_ruleset and so on, on every architecture


def _call(*arguments: object) -> int:
    """Make a system call.

    Raises
    ------
    OSError
    """
    result = _LIBC.syscall(*(ctypes.c_long(value) if isinstance(value, int) else value for value in arguments))
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
    return int(result)


def landlock_version() -> int:
    """Return the version of the kernel's Landlock; 0 without Landlock."""
    try:
        return _call(_CREATE, None, 0, 1)
    except OSError:
        return 0


@functools.cache
def _bubblewrap_works(program: str) -> bool:
    trial = [program, "--unshare-all", "--ro-bind", "/", "/", sys.executable, "-I", "-S", "-c", ""]
    return subprocess.run(trial, capture_output=True, check=False, timeout=60).returncode == 0


def available() -> tuple[Means, ...]:
    """Return the means of containment on this machine, the best first."""
    landlock = landlock_version() and platform.machine() in _NUMBERS
    program = shutil.which("bwrap")
    wrapped = program and _bubblewrap_works(program)
    return (*(("landlock",) if landlock else ()), *(("bubblewrap",) if wrapped else ()))


def means() -> Means:
    """Return the means by which a process is contained on this machine."""
    return next(iter(available()), "none")


def bubblewrap(reach: Reach, folder: str) -> list[str]:
    """Return the words before a command with which bubblewrap runs it within reach, in a folder."""
    words = [shutil.which("bwrap") or "bwrap", "--unshare-all", "--die-with-parent", "--new-session"]
    words += ["--proc", "/proc", "--dev", "/dev", "--tmpfs", "/tmp"]
    for path in reach.read:
        words += ["--ro-bind-try", path, path]
    for path in reach.write:
        words += ["--bind", path, path]
    return [*words, "--remount-ro", "/", "--chdir", folder]


# --- in the process itself


def limit(memory: int | None, seconds: float, largest_file: int) -> None:
    """Set limits of address space, total processor time and file size that this process cannot lift."""
    limits = {resource.RLIMIT_FSIZE: largest_file, resource.RLIMIT_CORE: 0}
    if memory is not None:
        limits[resource.RLIMIT_AS] = memory
    if seconds < 2**31:
        limits[resource.RLIMIT_CPU] = int(seconds) * (os.cpu_count() or 1) + 60
    for kind, value in limits.items():
        _, hard = resource.getrlimit(kind)
        value = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(kind, (value, value))


def end_with_parent() -> None:
    """Let the kernel end this process when the one that started it ends."""
    _LIBC.prctl(1, signal.SIGKILL, 0, 0, 0)


class _Rules(ctypes.Structure):
    _fields_ = (("files", ctypes.c_uint64), ("network", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class _Below(ctypes.Structure):
    _pack_ = 1
    _layout_ = "ms"
    _fields_ = (("allowed", ctypes.c_uint64), ("folder", ctypes.c_int32))


# Rights on files by their bits in linux/landlock.h; each version knows those below its bit.
_RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15}
_READ = 1 << 2 | 1 << 3
_OF_FILES = 1 << 0 | 1 << 1 | 1 << 2 | 1 << 14 | 1 << 15
_NEVER = 1 << 0 | 1 << 6 | 1 << 9 | 1 << 10 | 1 << 11 | 1 << 12 | 1 << 15  # execute, devices, sockets, fifos, links


def keep_to(reach: Reach, network: bool = False) -> None:
    """Restrict this thread, and what it starts, to its files by Landlock; without ``network``, also deny TCP.

    May be called again, to restrict further.
    """
    version = landlock_version()
    every = (1 << _RIGHTS.get(version, 16)) - 1
    rules = _Rules(every, 0 if network or version < 4 else 3, 3 if version >= 6 else 0)
    size = 8 if version < 4 else 16 if version < 6 else 24
    ruleset = _call(_CREATE, ctypes.byref(rules), size, 0)
    for paths, rights in ((reach.read, _READ), (reach.write, every & ~_NEVER)):
        for path in paths:
            _allow(ruleset, path, rights & every)
    _LIBC.prctl(38, 1, 0, 0, 0)  # no new privileges
    _call(_RESTRICT, ruleset, 0)
    os.close(ruleset)


def _allow(ruleset: int, path: str, rights: int) -> None:
    try:
        handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return  # a missing file needs no right
    rights &= -1 if Path(path).is_dir() else _OF_FILES
    _call(_ADD, ruleset, 1, ctypes.byref(_Below(rights, handle)), 0)
    os.close(handle)


# Numbers of system calls (x86_64, aarch64): programs, processes, sockets, other processes' memory, modes and owners.
_NUMBERS: dict[str, tuple[int, ...]] = {
    "x86_64": (
        *(41, 53, 42, 49, 50),  # socket, socketpair, connect, bind, listen
        *(57, 58, 59, 322),  # fork, vfork, execve, execveat
        *(101, 310, 311, 425, 438),  # ptrace, process_vm_readv and _writev, io_uring_setup, pidfd_getfd
        *(90, 91, 268, 452, 92, 93, 94, 260, 188, 189, 190),  # chmod, chown, setxattr and the like
        *(175, 313, 321, 165, 272, 308, 248, 249, 250),  # modules, bpf, mount, unshare, setns, keys
    ),
    "aarch64": (
        *(198, 199, 203, 200, 201),
        *(221, 281),
        *(117, 270, 271, 425, 438),
        *(52, 53, 452, 54, 55, 5, 6, 7),
        *(105, 273, 280, 40, 97, 268, 217, 218, 219),
    ),
}
_CLONE = {"x86_64": 56, "aarch64": 220}
_ARCHITECTURE = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
_CLONE3, _CLONE_THREAD = 435, 0x10000
_SECCOMP = {"x86_64": 317, "aarch64": 277}
_ALLOW, _DENY, _UNKNOWN = 0x7FFF0000, 0x00050001, 0x00050026  # EPERM; ENOSYS, after which libc takes clone


def _filter(machine: str) -> bytes:
    """Return the filter program in classic BPF: it permits threads, but no processes and programs."""
    load, equal, at_least, any_bit, end = 0x20, 0x15, 0x35, 0x45, 0x06
    denied = _NUMBERS[machine]
    tests = [(equal, _CLONE3), *((equal, number) for number in denied), (at_least, 0x40000000)]
    # The last five: clone, its flags, then the three ends.
    count = len(tests)
    program = [(load, 0, 0, 4), (equal, 1, 0, _ARCHITECTURE[machine]), (end, 0, 0, _DENY), (load, 0, 0, 0)]
    for k, (test, number) in enumerate(tests):
        rest = count - 1 - k
        program.append((test, rest + (5 if k == 0 else 3), 0, number))
    program += [(equal, 0, 3, _CLONE[machine]), (load, 0, 0, 16), (any_bit, 1, 0, _CLONE_THREAD)]
    program += [(end, 0, 0, _DENY), (end, 0, 0, _ALLOW), (end, 0, 0, _UNKNOWN)]
    return b"".join(struct.pack("HBBI", *line) for line in program)


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


def start_nothing() -> None:
    """Filter the system calls of all threads: no programs, processes, sockets, foreign memory, modes of files."""
    machine = platform.machine()
    if machine not in _NUMBERS:
        return
    code = _filter(machine)
    _LIBC.prctl(38, 1, 0, 0, 0)
    if _call(_SECCOMP[machine], 1, 1, ctypes.byref(_Program(len(code) // 8, code))):
        raise OSError("a thread of this process cannot be filtered")


def drop_capabilities() -> None:
    """Drop all of root's capabilities beyond its files."""
    header, none = struct.pack("Ii", 0x20080522, 0), bytes(24)
    _LIBC.capset(header, none)


def contained(words: Sequence[str], reach: Reach, folder: str, by: Means) -> list[str]:
    """Return the command that starts a process, within bubblewrap if that contains it."""
    return [*bubblewrap(reach, folder), *words] if by == "bubblewrap" else list(words)
