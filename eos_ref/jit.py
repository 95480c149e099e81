"""Compilation by numba, with compiled code kept on disk.

Files are named by their path below ``eos_ref``.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

import hashlib
import logging
from pathlib import Path
from typing import Any

import numba
from numba.core import codegen

from eos_ref.cache import cache_folder

SOURCES = ("jit.py", "numbers/elementary.py", "eos/laws.py", "eos/registry.py", "eos/compiled.py")


def cache_directory(sources: tuple[str, ...] = SOURCES) -> Path:
    """Return the folder of compiled code that depends on some files, a new one when any of them changes."""
    # numba notices changes of the file that holds a loop, but not of the law it calls: key the cache by both.
    digest = hashlib.sha256()
    for name in sources:
        digest.update((Path(__file__).parent / name).read_bytes())
    return cache_folder(f"numba/{digest.hexdigest()[:16]}")


def announce_first_use(loop: Any) -> None:
    """Say that loops have to be compiled, if this one is not on disk yet."""
    if not loop.signatures and next(Path(loop.stats.cache_path).glob(f"*{loop.__name__}*.nbi"), None) is None:
        logging.getLogger("eos_ref").warning("eos-ref: compiling the particle model, once on this machine (some 20 s)")


def cached(*sources: str, signature: str | list[str] | None = None) -> Any:
    """Return a decorator of a compiled loop that is kept on disk until one of these files, or of `SOURCES`, changes.

    With a signature, or some, it is compiled at once, for these alone.
    """
    folder = str(cache_directory((*SOURCES, *sources)))

    def decorate(loop: Any) -> Any:
        # Other packages' functions stay where they were: the setting is read when a loop is decorated.
        users, numba.config.CACHE_DIR = numba.config.CACHE_DIR, folder
        try:
            return numba.njit(signature, cache=True, error_model="numpy", nogil=True)(loop)
        finally:
            numba.config.CACHE_DIR = users

    return decorate


def keep_nothing() -> None:
    """Load what is kept, and keep nothing more: for a process that may only read the cache."""
    numba.core.caching.Cache.save_overload = lambda *_: None
    numba.core.caching._CacheLocator.ensure_cache_path = lambda _: None  # writes a file to see whether it may


def _use_wide_registers() -> None:
    """Let loops have registers of 512 bits, where there are any: LLVM takes halves of them on most of Intel's.

    The bits are the same. A law that is bound by arithmetic takes two thirds of the time (`eos-ref bench laws`).
    """
    features = codegen.get_host_cpu_features()
    if numba.config.CPU_FEATURES is None and "+avx512f" in features.split(","):
        numba.config.CPU_FEATURES = f"{features},-prefer-256-bit"


_use_wide_registers()

# LLVM does not inline a body as long as a power of its own accord, and a loop with a call in it stays scalar.
inline = numba.njit(error_model="numpy", forceinline=True)
