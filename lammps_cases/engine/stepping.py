"""LAMMPS step by step: the one instance that a process keeps open, and a job that is advanced between readings."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from lammps_cases.engine import session
from lammps_cases.engine.session import Array, EngineBroken, Job, RunCommand, translated


class Instance:
    """LAMMPS in this process: opened when first needed, and anew after an error that broke it."""

    def __init__(self, site: str | None = None) -> None:
        self.site = site
        self._lmp: Any = None

    @property
    def is_open(self) -> bool:
        """Return whether there is an instance that may be used."""
        return self._lmp is not None

    @contextmanager
    def use(self) -> Iterator[Any]:
        """Give the instance to a block of calls.

        Raises
        ------
        EngineMissing
            There is no LAMMPS with RHEO.
        EngineRefused
            LAMMPS' own error; of an `EngineBroken` the instance is forgotten.
        """
        if self._lmp is None:
            self._lmp = session.open_lammps(self.site)
        try:
            with translated():
                yield self._lmp
        except EngineBroken:
            self._lmp = None
            raise


@functools.cache
def instance(site: str | None) -> Instance:
    """Return this process' LAMMPS; `clear` between jobs takes 5 ms where a new instance takes 100."""
    return Instance(site)


class Stepping:
    """A job that is set up in an instance, then advanced and read in turns.

    Every method raises `EngineRefused` with LAMMPS' error, or `EngineBroken`.
    """

    def __init__(self, lmp: Any, job: Job) -> None:
        self.lmp, self.job, self.step = lmp, job, 0

    def begin(self) -> None:
        """Set up and evaluate once."""
        session.run(self.lmp, replace(self.job, runs=(RunCommand("run 0 post no"),)))
        self.step = 0

    def advance(self, steps: int) -> None:
        """Take steps; without `pre no` a run begins with an evaluation that a continued run does not have."""
        with translated():
            self.lmp.command(f"run {steps} pre no post no")
        self.step += steps

    def read(self) -> dict[str, Array]:
        """Return the job's arrays now, by id; of fewer atoms than were created if some are lost."""
        with translated():
            return session.read(self.lmp, self.job.outputs, self.job.atom_arrays, self.job.computes)

    def lost(self, id_n: Array) -> Array:
        """Return the ids that are among those read or those created, not among both."""
        return np.setxor1d(id_n, self.job.id_n)
