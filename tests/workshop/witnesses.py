"""List every rule of the reference with the cases that depend on it, found by breaking the rule.

A case is a witness of a rule if a mistake that breaks it takes a compared field out of its bound. Every rule needs two
witnesses in different scenes, in 2D and in 3D; and a case has to be a witness of every rule that it names
(`exercises`). LAMMPS is not run. Exit code 1 if a rule or a case falls short.

Example:  make witnesses WITNESSES='surfaces-3d.* --all'
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence

from lammps_cases.comparison.store import open_store
from lammps_cases.records.progress import Bar
from lammps_cases.records.wording import counted
from lammps_cases.scene import casefile
from tests.workshop import command
from tests.workshop.faults import witnesses


def main(words: Sequence[str] | None = None) -> int:
    """Examine the cases, print the rules, and return 1 if anything is missing."""
    options = command.parser(__doc__)
    options.add_argument("names", nargs="*", metavar="CASE")
    options.add_argument("--all", action="store_true", help="all rules that a case exercises, not only those it names")
    return command.run(options, words, _listed)


def _listed(given: Namespace) -> int:
    cases = casefile.select(casefile.load(), given.names)
    with Bar() as bar:
        examined = witnesses.collect(cases, given.all, given.jobs, open_store(), bar)
    rows = witnesses.rows(examined)
    complaints = list(witnesses.complaints(cases, examined, rules=not given.names))
    for row in rows:
        if not given.names or any(row.cases.values()):  # of some cases those alone that they witness
            print(f"{row.rule}: {row.sentence}")
            for dimension, names in row.cases.items():
                print(f"  {dimension}D: {', '.join(names)}")
    print(f"{counted(len(rows), 'rule')}, {counted(len(examined), 'case')}, {counted(len(complaints), 'complaint')}")
    for complaint in complaints:
        print(f"  {complaint}")
    return int(bool(complaints))


if __name__ == "__main__":
    sys.exit(main())
