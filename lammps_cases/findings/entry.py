"""One finding: what it says, the engines that have it, what reproduces or predicts it, and where else it shows."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eos_ref import EOSTable
from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from lammps_cases.comparison.compare import EosState
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.engines import nearest, since
from lammps_cases.findings.variants import Variant
from lammps_cases.records.case_parts import Ended, Verdict
from lammps_cases.records.levels import Severity
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.wording import FACTOR, times

if TYPE_CHECKING:
    from lammps_cases.scene import Scene

DECK_ROUNDING = 16 * EPS  # of a mass that a deck calculates, such as 1000*0.1^3

Law = Callable[[EOSTable, EosState], FloatArray]


@dataclass(frozen=True)
class DeckRun:
    """A run of a user's deck by its definitions, before its first step.

    Attributes
    ----------
    problem : the particles at its beginning, with what steps need as fields
    again : whether the state comes from a run, or a file, before
    reacts : whether particles that freeze are bonded (rheo/thermal, react)
    created : whether particles were created after a run
    deforms : whether the box changes while periodic images stay behind (fix deform without remap v)
    shown : what the deck computes and prints: styles of computes, attributes, keywords of thermo_style
    """

    problem: Problem
    again: bool = False
    reacts: bool = False
    created: bool = False
    deforms: bool = False
    shown: frozenset[str] = frozenset()


def multiplied(what: str, factor_t: Sequence[float]) -> str:
    """Return by how much values are multiplied for the particles of each type; nothing where all factors are 1."""
    wrong = {t: _how_often(factor) for t, factor in enumerate(factor_t, 1) if abs(factor - 1) > DECK_ROUNDING}
    every = len(wrong) == len(factor_t) and len(set(wrong.values())) == 1
    parts = [f"{how} what they should be{'' if every else f' for type {t}'}" for t, how in wrong.items()]
    return f"{what} are {parts[0] if every else ', '.join(parts)}" if parts else ""


def _how_often(factor: float) -> str:
    return f"1/{times(1 / factor)} of" if 0 < factor <= 1 / FACTOR else f"{times(factor)} times"


@dataclass(frozen=True)
class MapDifference:
    """A stability map on which LAMMPS and the reference fail at different places; ``layer`` None: on all layers."""

    map: str
    why: str
    layer: str | None = None


@dataclass(frozen=True)
class AlarmDifference:
    """Restatements of a scene under which LAMMPS differs although an ordinary run of the scene does not show it.

    Attributes
    ----------
    kinds : how LAMMPS is given the scene, see ``make power`` (alarms)
    applies : to which scenes
    """

    kinds: tuple[str, ...]
    applies: Callable[[Scene], bool]
    why: str


@dataclass(frozen=True)
class Gap:
    """Scenes that a finding changes and that its variant does not reproduce."""

    applies: Callable[[Scene], bool]
    why: str


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes
    ----------
    number : place in the ledger, where variants are tried and named in the order in which they were added
    effect : what it does to a user, in one line
    documented, observed : what the manual says (with its place), what LAMMPS does
    argument : why the documented behaviour is the right one
    workaround : what a user can do meanwhile
    upstream : what LAMMPS knows of it: unreported, the address of an issue, or "fixed in VERSION"
    engines : versions of LAMMPS that were seen to have it, from `lammps_cases.findings.engines`
    applies_to : patterns of the cases that it speaks of, for all findings without a model variant; with one, of the
        probes that measure what follows from it
    scene : the smallest scene that shows it
    law_variant : replaces the reference's pressure, for a finding in an equation of state
    model_variant : the variant of the particle model, for a finding in its fields
    ends : part of LAMMPS' error on a scene that shows it, whatever its name; empty on others, for a finding in refusals
    outcome, ended, engine_error : verdict, end (if it has another name) and part of LAMMPS' error that it predicts,
        for a finding in refusals
    differing : field in which it predicts that the two decks of a probe differ, or what it predicts to be measured as
        another number
    replaces : functions of the reference whose result no case compares, as LAMMPS with this finding has another one
    expected_in_maps, expected_in_alarms : where else the engines differ by it
    gaps : scenes of which it is known that the variant does not reproduce them
    acts : what it does to a run of a deck by the deck's definitions, in words; True: its effect; False: nothing
    accepts : arguments that the manual forbids and LAMMPS accepts, as the reference's input errors name them
    expected_inputs : bad inputs (ids of the table of `eos-ref stability`) that LAMMPS treats as the finding says
    """

    id: str
    number: int
    title: str
    severity: Severity
    effect: str
    documented: str
    observed: str
    argument: str
    workaround: str
    upstream: str = "unreported"
    engines: tuple[str, ...] = ()
    applies_to: tuple[str, ...] = ()
    scene: str = ""
    law_variant: Law | None = None
    model_variant: Variant | None = None
    ends: Callable[[Scene], str] = lambda scene: ""
    outcome: Verdict | None = None
    ended: Ended | None = None
    engine_error: str = ""
    differing: str = ""
    replaces: tuple[str, ...] = ()
    expected_in_maps: tuple[MapDifference, ...] = ()
    expected_in_alarms: tuple[AlarmDifference, ...] = ()
    gaps: tuple[Gap, ...] = ()
    acts: Callable[[DeckRun], str | bool] = lambda setting: False
    accepts: tuple[str, ...] = ()
    expected_inputs: tuple[str, ...] = ()

    @property
    def named_variant(self) -> str:
        """Return the name of the variant that reproduces it, or the outcome that it predicts."""
        model = self.model_variant
        part = self.law_variant or (model and (model.stages or model.stepping))
        return part.__name__ if part else (self.outcome or "")

    @property
    def since(self) -> str:
        """Return since which version it is there, as far as versions were tried; empty if it was seen on none."""
        return since(self.engines)

    def covers(self, case: str) -> bool:
        """Return whether the entry speaks of a case by its name."""
        return any(fnmatch.fnmatchcase(case, pattern) for pattern in self.applies_to)

    def predicts(self, record: CaseRecord) -> bool:
        """Return whether a case ended without numbers as the entry says."""
        ended = self.ended or self.outcome
        if self.outcome != record.verdict or ended != record.ended or self.engine_error not in record.engine_error:
            return False
        return not self.differing or (record.mismatch is not None and self.differing in record.mismatch.fields)

    def foretells(self, record: CaseRecord, scene: Scene) -> bool:
        """Return whether a scene of any name ended without numbers as the entry says of it."""
        text = self.ends(scene)
        return bool(text) and self.outcome == record.verdict == record.ended and text in record.engine_error

    def acting(self, setting: DeckRun) -> str:
        """Return what it does to a run of a deck by the deck's definitions; nothing if it does not act."""
        does = self.acts(setting)
        return self.effect if does is True else does or ""

    def listed(self, engine: str) -> bool:
        """Return whether a version of LAMMPS was seen to have it, or else the nearest one that was taken in."""
        return engine in self.engines or nearest(engine) in self.engines

    def new_on(self, engine: str) -> bool:
        """Return whether a version of LAMMPS that shows it is the first to do so: neither it nor the nearest had it."""
        return bool(engine and self.engines) and not self.listed(engine)
