"""Runs kept over time: how verdicts, errors and times went from one engine, and one day, to the next.

`collect` keeps a run and `past` says what was before it; a history that cannot be used never fails a run.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from eos_ref.errors import InputError

if TYPE_CHECKING:
    from lammps_cases.records.run_record import RunRecord
    from lammps_cases.report.history.reported import Past


def collect(run: RunRecord, directory: Path | None = None) -> None:
    """Keep a run in the user's history; what goes wrong is one line on standard error and nothing else.

    ``directory`` is its report folder, if it has one: making its run.json again takes half of the time.
    """
    from lammps_cases.report.history import store

    with _forgiven("this run is not in the history"):
        if place := store.history_file():
            content = (directory / "run.json").read_bytes() if directory else None
            with store.History(place) as history:
                history.add(run, content, _revision())


def past(run: RunRecord) -> Past | None:
    """Return what a report shows of the runs before this one; None without a readable history."""
    from lammps_cases.report.history import store
    from lammps_cases.report.history.reported import before

    with _forgiven("the report shows no history"):
        if place := store.history_file():
            with store.History(place) as history:
                return before(history, run)
    return None


@contextmanager
def _forgiven(complaint: str) -> Iterator[None]:
    """Report a history that cannot be used in one line on standard error, and go on."""
    try:
        yield
    except (InputError, OSError) as error:
        print(f"eos-ref: {complaint}: {' '.join(str(error).split())}", file=sys.stderr)


def _revision() -> str:
    """Return the git revision of the sources, with ``-dirty`` if files were changed; empty if they are installed."""
    root = Path(__file__).parents[3]
    if not (root / ".git").exists():
        return ""
    try:
        described = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*", "--abbrev=12"],
            capture_output=True,
            text=True,
            timeout=5,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return described.stdout.strip() if described.returncode == 0 else ""
