"""Runs of commands in their own LAMMPS: in a worker that they may kill, in a folder that is removed with them."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from lammps_cases.engine import apart, session
from lammps_cases.engine.session import Array, Job
from lammps_cases.engine.workers import Failure, Workers

if TYPE_CHECKING:  # a worker process starts in half the time without pydantic
    from lammps_cases.claims.probes.probe import Input
    from lammps_cases.records.case_parts import Failed

MEASURED = ("found", "expected", "within")  # variables of a deck that measures
HEAT = ("esph", "temperature", "conductivity", "heatflow")
PROPERTIES = ("type", "x", "v", "f", "rho", "pressure", "drho", "viscosity", *HEAT)  # read if the style has them


@dataclass(frozen=True)
class Reply:
    """LAMMPS' result for an input.

    Attributes
    ----------
    ended : how it ended; "lost" if LAMMPS left out atoms silently
    error : its error, or its last output when it died
    arrays : per-atom arrays at the end, by id
    log : the log of a deck
    """

    ended: Literal["answered", "lost"] | Failed
    error: str = ""
    arrays: dict[str, Array] = field(default_factory=dict)
    log: str = ""


def put(workers: Workers, inputs: Sequence[Input], time_limit: float, alone: bool = False) -> Iterator[Reply]:
    """Run inputs in LAMMPS, all at once, and yield the replies in order.

    Parameters
    ----------
    time_limit : float
        Seconds that LAMMPS has for each.
    alone : bool
        Each in its own process, untouched by any other input.
    """
    if alone:  # the worker outlives the input, and reports a timeout itself
        futures = [workers.call(ask_apart, given, time_limit, time_limit=10 * time_limit) for given in inputs]
    else:
        futures = [workers.call(ask, given, time_limit=time_limit) for given in inputs]
    for future in futures:
        outcome = workers.outcome(future)
        yield Reply(outcome.verdict, outcome.message) if isinstance(outcome, Failure) else outcome


def ask_apart(site: str | None, given: Input, time_limit: float) -> Reply:
    """Task: run an input in a fork of this process, which has loaded LAMMPS and not opened it."""
    session.load(site)
    try:
        return apart.call(ask, site, given, time_limit=time_limit)
    except TimeoutError as error:
        return Reply("timeout", str(error))


def ask(site: str | None, given: Input) -> Reply:
    """Task: run an input in a LAMMPS untouched by any other input."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), session.Session(site) as lmp:
        try:
            return _job(lmp, given) if isinstance(given, Job) else _deck(lmp, given)
        except session.EngineLost as error:
            return Reply("lost", str(error))
        except session.EngineRefused as error:
            return Reply("refused", str(error))
        except UnicodeDecodeError as error:  # LAMMPS' module cannot read a message that breaks a character in two
            return Reply("refused", error.object.decode(errors="replace"))


def _job(lmp: Any, given: Job) -> Reply:
    lmp.command("log deck.log")
    arrays = session.run(lmp, given).arrays
    lmp.command("log none")
    return Reply("answered", arrays=arrays, log=Path("deck.log").read_text(errors="replace"))


def _deck(lmp: Any, lines: tuple[str, ...]) -> Reply:
    with session.translated():
        lmp.command("log deck.log")
        lmp.commands_string("\n".join(lines))
        arrays = _arrays(lmp) | _measured(lmp)
        lmp.command("log none")
    return Reply("answered", arrays=arrays, log=Path("deck.log").read_text(errors="replace"))


def _measured(lmp: Any) -> dict[str, Array]:
    """Return a deck's measured number, the expected one, and the bound of their difference, if it has them."""
    if not all(lmp.has_id("variable", name) for name in MEASURED):
        return {}
    return {name: np.array([lmp.extract_variable(name)]) for name in MEASURED}


def _arrays(lmp: Any) -> dict[str, Array]:
    n = lmp.extract_global("nlocal")
    order_n = np.argsort(lmp.numpy.extract_atom("id")[:n])
    arrays: dict[str, Array] = {}
    for name in PROPERTIES:
        values_n = lmp.numpy.extract_atom(name)
        if values_n is not None:
            arrays[name] = np.array(values_n[:n][order_n], float)
    if lmp.has_id("compute", "q"):
        columns = lmp.numpy.extract_compute("q", 1, 2 if lmp.extract_compute("q", 1, 5) else 1)
        arrays["q"] = np.array(columns[:n][order_n], float)
    return arrays
