"""Plant faults in LAMMPS' input, in its output and in the formulas, and report which case catches each.

Sections: faults, resolution (the smallest visible change of every parameter), alarms (failures although nothing is
wrong); all by default, only the first if faults are named. Writes power.json; an interrupted run is resumed.

  `told`     LAMMPS' input is altered
  `read`     its output is corrupted
  `formula`  named mistakes in formulas; the mistaken reference stands in for LAMMPS

Examples:  `make power POWER='faults --quick-only'`
           `make power POWER='told.cs-* --all'`
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence

from lammps_cases.records.progress import Bar
from tests.workshop import command
from tests.workshop.faults import collect, record
from tests.workshop.faults.fault import FAMILIES, SECTIONS


def main(words: Sequence[str] | None = None) -> int:
    """Measure, print the results, and return 1 if anything is wrong."""
    options = command.parser(__doc__, "reports/power")
    options.add_argument("names", nargs="*", metavar="SECTION|FAULT")
    options.add_argument("--family", choices=FAMILIES, help="only faults of this family")
    options.add_argument("--quick-only", action="store_true", help="only the quick cases")
    options.add_argument("--sample", type=int, metavar="N", help="only N of the faults, the same ones each time")
    options.add_argument("--all", action="store_true", help="find every case that catches a fault")
    options.add_argument("--fresh", action="store_true", help="redo what the folder has")
    return command.run(options, words, _measured)


def _measured(given: Namespace) -> int:
    patterns = [name for name in given.names if name not in SECTIONS]
    only_faults = patterns or given.family or given.sample
    sections = [name for name in given.names if name in SECTIONS] or (["faults"] if only_faults else SECTIONS)
    collect.select(collect.faults(), patterns)  # a typo is refused before any stored result is deleted
    with record.planted(given.out).resumed(not given.fresh), Bar() as bar:
        power = collect.collect(given, sections, patterns, bar)
        record.write(power, given.out)
    show(power)
    return int(bool(power.complaints))


def show(power: record.Power) -> None:
    """Print the results."""
    for control in power.controls:
        if own := [fault for fault in power.faults if fault.family == control.family]:
            caught, quick = sum(bool(fault.caught_by) for fault in own), sum(fault.quick for fault in own)
            print(f"{control.family:8s} {caught:4d} of {len(own):4d} caught, {quick:4d} by quick cases")
    if total := len(power.faults):
        argued = sum(bool(fault.argued) for fault in power.faults)
        print(f"{power.caught} of {total} faults caught ({power.caught / total:.1%}), {power.quick} by quick cases")
        print(f"{len(power.single)} by the cases of a single file, {len(power.hidden)} only where no finding of the")
        print(f"engine stands in their place; {argued} argued ({power.seconds:.0f} s)")
        for fault in power.single:
            print(f"  caught by a single file only: {fault.id}: {', '.join(fault.caught_by)}")
    for one in power.resolution:
        where = f"{one.relative_change:.1e} in {one.case}" if one.relative_change is not None else "not seen"
        print(f"{one.parameter:28s} {where}")
    for run in power.alarms:
        print(f"{run.kind:12s} {run.cases:4d} cases, {run.same_bits} bit-identical, {run.false} false alarms")
        for alarm in run.alarms:
            print(f"  {alarm.case}: {alarm.message}" + (f"; finding {alarm.finding}" if alarm.finding else ""))
    for complaint in power.complaints:
        print(f"  {complaint}")


if __name__ == "__main__":
    sys.exit(main())
