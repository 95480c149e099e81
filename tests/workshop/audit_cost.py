"""Cost of the samples: processor time of a deck's first run with and without them, measured alternately.

``python -m tests.workshop.audit_cost DECK [STEPS [EVERY [REPEATS]]]`` prints both times of every turn and the ratio of
the smallest ones. The deck's first run is cut to STEPS steps on both sides; each measurement is a process of its own.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from lammps_cases.audit.follow import Follower
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.place import copy_folder
from lammps_cases.audit.watch import DeckWatch
from lammps_cases.engine.session import Session


class _FirstRun(DeckWatch):
    """Times the first run and ends the deck after it."""

    audited = True
    spent = 0.0

    def run(self, values: list[str], execute: Callable[..., None]) -> bool:
        begin = time.process_time()
        if self.audited:
            self.begin(["run"])
        self.lmp.command(f"run {self.options.steps}")
        if self.audited:  # by which the stored samples are judged
            self.questions.lines()
        self.spent = time.process_time() - begin
        return True


def first_run(deck: str, steps: int, every: int, audited: bool) -> float:
    """Return the processor seconds of a deck's first run, cut to ``steps`` steps."""
    with tempfile.TemporaryDirectory() as folder:
        copy_folder(Path(deck).resolve().parent, Path(folder))
        os.chdir(folder)
        session = Session()
        watch = _FirstRun(
            session.open(),
            AuditOptions(every=every, steps=steps),
            lambda message: None,
            session.describe()["distribution"],
        )
        watch.audited = audited
        Follower(session.open(), watch, lambda where, command: None).deck(Path(Path(deck).name))
        session.close()
        os.chdir("/")
    return watch.spent


def main(deck: str, steps: str = "400", every: str = "10", repeats: str = "5") -> None:
    """Measure and print."""
    seconds: dict[bool, list[float]] = {True: [], False: []}
    context = multiprocessing.get_context("spawn")
    for _ in range(int(repeats)):
        for audited in (False, True):
            with context.Pool(1) as pool:
                task = (deck, int(steps), int(every), audited)
                seconds[audited].append(pool.apply(first_run, task))
        print(f"plain {seconds[False][-1]:.3f} s, audited {seconds[True][-1]:.3f} s", flush=True)
    print(f"{Path(deck).name}: ratio of the smallest {min(seconds[True]) / min(seconds[False]):.4f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
