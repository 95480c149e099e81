"""Mutants of the judge that survive its tests, and why no test can detect them (``make judge``).

mutmut changes one expression at a time in comparison, verdict and findings, and runs the tests that reach it, except
those that need LAMMPS. Survivors judge recorded answers of LAMMPS (`tests.workshop.recorded_answers`),
which variants of the reference have to reproduce. The rest is either argued in ``judge.yaml`` or a gap.
"""

from __future__ import annotations

import collections
import json
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from tests.workshop.faults.record import arguments

MUTANTS = Path("mutants")  # the copy of the project that mutmut makes
ANSWERED = MUTANTS / "answered.json"  # the fate of survivors that judge answers of LAMMPS
ARGUED = Path(__file__).with_name("judge.yaml")
BY_ANSWERS = "by answers"
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
    """Return the survivors, as (function, change), that no argument covers; one for ``*`` covers all changes."""
    argued = arguments(ARGUED).keys()
    return [(f, what) for f, what in survivors if (f, what) not in argued and (f, "*") not in argued]


def mutmut(*words: str) -> str:
    """Return what mutmut prints."""
    command = [str(Path(sys.executable).with_name("mutmut")), *words]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def table(status_of: Mapping[str, str]) -> list[str]:
    """Return lines of counts: mutants by fate, for every module and for all."""
    rows = [(mutant.split(".")[1:3], status) for mutant, status in status_of.items()]
    names = [f"{room}.{module}" for (room, module), _ in rows]
    counts = {
        name: collections.Counter(s for n, (_, s) in zip(names, rows, strict=True) if n == name) for name in names
    }
    total = collections.Counter(status_of.values())
    return [
        f"{name}: {each.total()} mutants, " + ", ".join(f"{n} {status}" for status, n in sorted(each.items()))
        for name, each in (*sorted(counts.items()), ("all", total))
    ]


def main() -> int:
    """Print the fate of the mutants, and the survivors that are not argued; return 1 if there are any."""
    status_of = statuses(mutmut("results", "--all", "true"))
    answered = json.loads(ANSWERED.read_text()) if ANSWERED.exists() else {}
    status_of |= {mutant: f"{BY_ANSWERS} {now}" for mutant, now in answered.items() if now in KILLED}
    alive = [mutant for mutant, status in status_of.items() if status.removeprefix(f"{BY_ANSWERS} ") not in KILLED]
    gaps = unargued((function_of(mutant), change(mutmut("show", mutant))) for mutant in alive)
    print("\n".join(table(status_of)))
    print(f"{len(alive)} not killed, {len(alive) - len(gaps)} of them argued in {ARGUED.name}")
    for function, what in gaps:
        print(f"  {function}: {what}")
    return int(bool(gaps) or not status_of)


if __name__ == "__main__":
    sys.exit(main())
