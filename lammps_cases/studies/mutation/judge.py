"""Mutants of the judge that its tests leave alive, and why no test can see them (``make judge``).

mutmut changes one expression at a time in comparison, verdict and findings, and runs the tests that reach it. What it
leaves alive is either argued in ``judge.yaml`` or a gap of the tests.
"""

from __future__ import annotations

import collections
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from lammps_cases.studies.mutation.record import arguments

ARGUED = Path(__file__).with_name("judge.yaml")
KILLED = ("killed", "timeout", "caught by type check", "segfault")


def statuses(results: str) -> dict[str, str]:
    """Return the status of every mutant, from the text of ``mutmut results --all true``."""
    lines = (line.strip().rpartition(": ") for line in results.splitlines() if "__mutmut_" in line)
    return {mutant: status for mutant, _, status in lines}


def function_of(mutant: str) -> str:
    """Return the function that a mutant changes; mutmut calls a function x_NAME and a method xǁCLASSǁNAME."""
    module, _, name = mutant.rpartition("__mutmut_")[0].rpartition(".")
    return f"{module}.{name[2:].replace('ǁ', '.')}"


def change(diff: str) -> str:
    """Return what a mutant changes, from the text of ``mutmut show``: the old lines, an arrow, the new ones."""
    lines = [line for line in diff.splitlines() if line[:1] in ("-", "+") and line[:3] not in ("---", "+++")]
    old, new = (" ".join(line[1:].strip() for line in lines if line[0] == sign) for sign in "-+")
    return f"{old} → {new}"


def unargued(survivors: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the survivors, as (function, change), that no argument speaks of; one for ``*`` is of all changes."""
    argued = arguments(ARGUED).keys()
    return [(f, what) for f, what in survivors if (f, what) not in argued and (f, "*") not in argued]


def _mutmut(*words: str) -> str:
    command = [str(Path(sys.executable).with_name("mutmut")), *words]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def main() -> int:
    """Print how many mutants the tests kill, and those alive that are not argued; return 1 if there are any."""
    status_of = statuses(_mutmut("results", "--all", "true"))
    alive = [mutant for mutant, status in status_of.items() if status not in KILLED]
    gaps = unargued((function_of(mutant), change(_mutmut("show", mutant))) for mutant in alive)
    counts = collections.Counter(status_of.values())
    print(f"{len(status_of)} mutants of the judge: " + ", ".join(f"{n} {name}" for name, n in sorted(counts.items())))
    print(f"{len(alive)} not killed, {len(alive) - len(gaps)} of them argued in {ARGUED.name}")
    for function, what in gaps:
        print(f"  {function}: {what}")
    return int(bool(gaps) or not status_of)


if __name__ == "__main__":
    sys.exit(main())
