"""PySPH, a peer that is never needed: scripts that run under a Python that has it, and print one JSON document."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from eos_ref.errors import InputError

SCRIPTS = Path(__file__).parent / "peers"
_NAME = "Python of PySPH"


def answer(python: str, *arguments: str, limit: float = 600.0) -> dict[str, Any]:
    """Return the document that a script prints in its last line.

    Parameters
    ----------
    python : str
        A Python that has PySPH.
    arguments : str
        Of that Python: a script, and its own.
    limit : float
        Seconds after which it is given up.

    Raises
    ------
    InputError
        That Python cannot be run, the script fails or takes too long, or its last line is no document.
    """
    try:
        done = subprocess.run([python, *arguments], check=False, capture_output=True, text=True, timeout=limit)
    except OSError as error:
        raise InputError(_NAME, f"cannot be run: {error.strerror}", python) from None
    except subprocess.TimeoutExpired:
        raise InputError(_NAME, f"must answer within {limit:g} s", python) from None
    if done.returncode:
        words = done.stderr.strip().splitlines()
        raise InputError(_NAME, f"cannot run its example: {words[-1] if words else 'no message'}", python)
    try:
        document = json.loads(done.stdout.splitlines()[-1])
        assert isinstance(document, dict)
    except (IndexError, ValueError, AssertionError):
        raise InputError(_NAME, "must print a JSON document in its last line", done.stdout[-80:]) from None
    return document


def version(python: str) -> str:
    """Return the version of the PySPH that a Python has; see `answer`."""
    return str(answer(python, "-c", "import json, pysph; print(json.dumps({'version': pysph.__version__}))")["version"])
