"""Preload for the fork server; garbage collection is off while importing.

Workers start with all that the server has imported frozen, so that no garbage collection scans it and thereby copies
its memory.
"""

from __future__ import annotations

import gc
import os


def _collect_garbage() -> None:
    gc.freeze()
    gc.enable()


gc.disable()
os.register_at_fork(after_in_child=_collect_garbage)
