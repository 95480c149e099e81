"""What the server that workers are forked from imports first: it looks for no garbage, of which imports make little.

A worker begins with all that the server has imported set aside, where no search for garbage goes through it, and copies
its memory by that.
"""

from __future__ import annotations

import gc
import os


def _collect_garbage() -> None:
    gc.freeze()
    gc.enable()


gc.disable()
os.register_at_fork(after_in_child=_collect_garbage)
