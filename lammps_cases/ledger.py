"""The ledger of findings: where LAMMPS differs from its manual, explained and reproduced.

An entry that changes numbers names a variant of the reference that reproduces LAMMPS on every atom; one that changes
how LAMMPS refuses predicts the outcome. Neither changes the reference or a bound.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from eos_ref import EOSTable
from eos_ref.eos import FloatArray
from lammps_cases.compare import Comparison, State, excess
from lammps_cases.records import Verdict

ALL = ("2025.7.22.0.1", "2025.7.22.1.0", "2025.7.22.2.0", "2025.7.22.4.0")
NEWEST = ALL[-1]
Variant = Callable[[EOSTable, State], FloatArray]


@dataclass(frozen=True)
class Entry:
    """One finding.

    Attributes
    ----------
    documented, observed : what the manual says (with its place), what LAMMPS does
    argument : why the documented behaviour is the right one
    workaround : what a user can do meanwhile
    cases : patterns of the cases that show it
    variant : replaces the reference's pressure, for a finding in numbers
    outcome, outcome_text : verdict and part of the message that it predicts, for a finding in refusals
    """

    id: str
    title: str
    severity: Literal["low", "medium", "high"]
    documented: str
    observed: str
    argument: str
    workaround: str
    cases: tuple[str, ...]
    engines: tuple[str, ...]
    variant: Variant | None = None
    outcome: Verdict | None = None
    outcome_text: str = ""

    def covers(self, case: str, engine: str) -> bool:
        """Whether the entry speaks of a case on an engine, given by its distribution's version.

        A finding is explained on the engines it was seen on, and nowhere else: where it comes back, or is met for the
        first time, it is red. A build without a distribution is taken as the newest.
        """
        listed = engine in self.engines or (not engine and NEWEST in self.engines)
        return listed and any(fnmatch.fnmatchcase(case, pattern) for pattern in self.cases)


LEDGER: tuple[Entry, ...] = (
    Entry(
        id="no-pressure-segfault",
        title="Asking for the pressure without fix rheo/pressure ends in a segmentation fault",
        severity="medium",
        documented="fix rheo, Restrictions: must be used in conjunction with fix rheo/pressure.",
        observed="Without fix rheo/pressure a run is refused with 'Missing fix rheo/pressure', unless a compute "
        "rheo/property/atom asks for the pressure: then the run ends in SIGSEGV before that check.",
        argument="The same omission gives an error or a crash depending on whether it is looked at. A crash loses the "
        "output buffers and, where LAMMPS is a library, the host program; the error would have named the cause.",
        workaround="Define fix rheo/pressure before the first run.",
        cases=("refused.no-fix-pressure-read",),
        engines=ALL,
        outcome="crashed",
        outcome_text="SIGSEGV",
    ),
    Entry(
        id="double-star-abort",
        title="A type range of two stars aborts the process",
        severity="low",
        documented="fix rheo/pressure, description of types: the forms are *, n, *n, m* and m*n.",
        observed="Other malformed ranges are refused ('Invalid range string'); '**' ends in SIGABRT with an uncaught "
        "std::invalid_argument.",
        argument="A mistyped argument is an input error like any other. An abort cannot be caught by a program that "
        "uses LAMMPS as a library, and no message names the line of the input.",
        workaround="Write a single star.",
        cases=("refused.range-two-stars",),
        engines=ALL,
        outcome="crashed",
        outcome_text="SIGABRT",
    ),
    Entry(
        id="hyphen-range-accepted",
        title="A type range with a hyphen is taken for its first number",
        severity="medium",
        documented="fix rheo/pressure, description of types: the forms are *, n, *n, m* and m*n.",
        observed="'1-2 linear' sets the law of type 1 alone, without a message; '* linear 1-2 tait/water' leaves type "
        "2 linear. Only if type 2 has no law at all is the command refused, for that reason.",
        argument="A user who writes 1-2 means both types. A law silently dropped for one of them changes its stiffness "
        "by any factor, while '1;2' or '0*' are refused as invalid.",
        workaround="Write 1*2.",
        cases=("refused.range-hyphen",),
        engines=ALL,
        outcome="differs",
        outcome_text="accepts what the manual refuses",
    ),
    Entry(
        id="unknown-style-misnamed",
        title="The error for an unknown pressure style names the types instead",
        severity="low",
        documented="fix rheo/pressure, syntax: pstyle is one of linear, tait/water, tait/general, cubic, ideal/gas, "
        "background.",
        observed="'* taitwater' is refused with 'Illegal fix command, *'; from 2025.7.22.2.0 on the message names "
        "taitwater.",
        argument="The types '*' are legal and the style is not: the message points at the wrong word of the command.",
        workaround="Look at the word after the one that the message names.",
        cases=("refused.unknown-style",),
        engines=("2025.7.22.0.1", "2025.7.22.1.0"),
        outcome="differs",
        outcome_text="Illegal fix command, *",
    ),
)


def explain_outcome(case: str, engine: str, verdict: Verdict, message: str) -> Entry | None:
    """The entry that predicts, for this engine, how a case ended without numbers."""
    for entry in LEDGER:
        if entry.outcome == verdict and entry.covers(case, engine) and entry.outcome_text in message:
            return entry
    return None


def explain_pressure(case: str, engine: str, table: EOSTable, state: State, comparison: Comparison) -> Entry | None:
    """The entry, for this engine, whose variant is within the bound on every atom."""
    for entry in LEDGER:
        if entry.variant is not None and entry.covers(case, engine):
            ratio_n = excess(comparison.lammps_n, entry.variant(table, state), comparison.bound_n)[1]
            if bool(np.all(ratio_n <= 1)):
                return entry
    return None
