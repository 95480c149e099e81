"""Shared by the commands of the workshop: their options, and one-line error messages."""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Sequence
from pathlib import Path

from eos_ref import InputError
from lammps_cases.engine import cluster, forkserver
from lammps_cases.engine.session import EngineMissing


def parser(about: str | None, out: str = "") -> ArgumentParser:
    """Return a parser with the common options; ``out`` is the folder that a command writes to."""
    options = ArgumentParser(description=about, formatter_class=RawDescriptionHelpFormatter)
    if out:
        options.add_argument("--out", type=Path, default=Path(out), help="folder of the results")
    options.add_argument("--engine", default="env", help="env, pypi:VERSION or path:PLACE")
    options.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at a time")
    options.add_argument("--cluster", default="", help="scheduler of a Dask cluster, tcp://HOST:PORT")
    return options


def run(options: ArgumentParser, words: Sequence[str] | None, main: Callable[[Namespace], int]) -> int:
    """Return the exit code: of a command, 2 for bad input, 3 without LAMMPS, 130 interrupted."""
    given = options.parse_args(words)
    try:
        forkserver.start_for_judging()
        if "out" in given:
            given.out.mkdir(parents=True, exist_ok=True)
        with cluster.used(given.cluster):
            return main(given)
    except (InputError, EngineMissing, KeyboardInterrupt) as error:
        print(error if str(error) else "interrupted", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 3 if isinstance(error, EngineMissing) else 130
