"""Draw random scenes over the whole schema of case files, and judge each as eos-ref run does.

Scenes that are red and not explained by a finding are kept as case files, and shrunk. Scene k of a seed is the same on
every machine with the same hypothesis. Writes fuzz.json; exit code 1 if something is unexplained; Ctrl-C reports what
was done so far.

Examples:  make fuzz FUZZ='--seconds 600 --seed 7'
           make fuzz FUZZ='--seed 7 --draw 123'
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence

from eos_ref import InputError
from lammps_cases.engine import installations
from lammps_cases.records.progress import Bar
from lammps_cases.records.wording import counted
from lammps_cases.run.provenance import command_line
from tests.workshop import command
from tests.workshop.fuzz.hunt import Hunt
from tests.workshop.fuzz.record import FuzzRecord

RAREST = 12  # choices named


def main(words: Sequence[str] | None = None) -> int:
    """Draw and judge scenes, print what was found, and return the exit code."""
    options = command.parser(__doc__, "reports/fuzz")
    options.add_argument("--seconds", type=float, default=60.0, help="time")
    options.add_argument("--seed", type=int, default=0, help="seed of the scenes")
    options.add_argument("--scenes", type=int, help="most scenes to draw")
    options.add_argument("--draw", type=int, help="only this scene, by its number")
    options.add_argument("--no-shrink", action="store_true", help="keep red scenes as drawn")
    return command.run(options, words, _hunted)


def _hunted(given: Namespace) -> int:
    if given.seconds <= 0 or given.seed < 0 or (given.draw or 0) < 0:
        raise InputError("seconds, seed, draw", "must be a time, and two numbers from 0", str(vars(given)))
    scenes = given.scenes if given.draw is None else 1
    with Bar(complaints=True) as bar:
        hunt = Hunt(
            installations.resolve(given.engine),
            given.seed,
            given.seconds,
            given.jobs,
            given.out,
            first=given.draw or 0,
            scenes=scenes,
            shrinks=not given.no_shrink,
            command=command_line(),
            progress=bar,
        )
        record = hunt.run()
    show(record)
    return record.exit_code


def show(record: FuzzRecord) -> None:
    """Print what was found."""
    counts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(record.verdicts.items()))
    end = "; interrupted" if record.interrupted else ""
    print(f"{counted(record.drawn, 'random scene')} of seed {record.seed}: {counts} ({record.seconds:.0f} s{end})")
    for red in record.red:
        print(f"  draw {red.draw}: {red.message}\n    {red.reproduce}")
        if red.small:
            print(f"    reduced to {counted(red.small_particles or 0, 'particle')}: {red.small}")
    for name, count in sorted(record.findings.items()):
        print(f"  {name}: {counted(count, 'scene')} explained")
    for name, count in record.gaps.items():
        print(f"  {name}: {counted(count, 'scene')} changed by it and not reproduced by any variant")
    print(f"  {counted(record.lost, 'scene')} with lost particles, in LAMMPS and the reference or only in the latter")
    print(f"  {counted(record.unbounded, 'scene')} with values without a bound, the rest reproduced by known findings")
    drawn = sum(map(bool, record.choices.values()))
    print(
        f"  {counted(record.twins, 'twin')}; {drawn} of {len(record.choices)} choices of the schema drawn, "
        f"{record.pairs_drawn} of {record.pairs} pairs, possible or not; "
        f"{100 * record.rejection:.1f} % of draws rejected as invalid"
    )
    rarest = sorted(record.choices.items(), key=lambda item: item[1])[:RAREST]
    print("  rarest: " + ", ".join(f"{choice} {count}" for choice, count in rarest))


if __name__ == "__main__":
    sys.exit(main())
