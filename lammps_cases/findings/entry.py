"""One finding: its text, the engines that have it, what reproduces or predicts it, and where else it shows."""

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
from lammps_cases.findings.document import FindingText
from lammps_cases.findings.engines import SEEN_ON, nearest, since
from lammps_cases.findings.variants import Variant
from lammps_cases.records.case_parts import Ended, Verdict
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
    problem : the particles at its beginning, with the fields that steps need
    again : whether the state comes from an earlier run, or a file
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
    """Return the factors of values by particle type, in words; empty where all factors are 1."""
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


@dataclass(frozen=True, kw_only=True)
class Finding(FindingText):
    """One finding: its text, and the predictions that every kind of finding has.

    Attributes
    ----------
    engines : versions of LAMMPS that were seen to have it, from `lammps_cases.findings.engines`
    applies_to : patterns of the cases that it covers by name; for a finding of the model, of probes that measure it
    outcome, ended, engine_error : verdict, end (if it has another name) and part of LAMMPS' error predicted for these
    differing : field in which it predicts that the two decks of a probe differ, or what it predicts to be measured as
        another number
    acts : its effect on a run of a deck, from the deck's definitions, in words; True: `effect`; False: none
    expected_in_maps : stability maps on which the engines differ by it
    """

    engines: tuple[str, ...] = ()
    applies_to: tuple[str, ...] = ()
    outcome: Verdict | None = None
    ended: Ended | None = None
    engine_error: str = ""
    differing: str = ""
    acts: Callable[[DeckRun], str | bool] = lambda setting: False
    expected_in_maps: tuple[MapDifference, ...] = ()

    def __post_init__(self) -> None:
        if not self.engines:
            object.__setattr__(self, "engines", SEEN_ON.get(self.id, ()))

    @property
    def model_variant(self) -> Variant | None:
        """Return the variant of the particle model that reproduces it, if there is one."""
        return None

    @property
    def named_variant(self) -> str:
        """Return the name of the variant that reproduces it, or the outcome that it predicts."""
        return self.outcome or ""

    @property
    def since(self) -> str:
        """Return the first version that has it, among those tried; empty if it was seen on none."""
        return since(self.engines)

    def covers(self, case: str) -> bool:
        """Return whether the entry covers a case by its name."""
        return any(fnmatch.fnmatchcase(case, pattern) for pattern in self.applies_to)

    def predicts(self, record: CaseRecord) -> bool:
        """Return whether a case ended without numbers as the entry predicts."""
        ended = self.ended or self.outcome
        if self.outcome != record.verdict or ended != record.ended or self.engine_error not in record.engine_error:
            return False
        return not self.differing or (record.mismatch is not None and self.differing in record.mismatch.fields)

    def predicts_of(self, record: CaseRecord, scene: Scene) -> bool:
        """Return whether it predicts, from the scene, how a case of any name ended without numbers."""
        return False

    def acting(self, setting: DeckRun) -> str:
        """Return its effect on a run of a deck, from the deck's definitions; empty if it does not act."""
        does = self.acts(setting)
        return self.effect if does is True else does or ""

    def listed(self, engine: str) -> bool:
        """Return whether a version of LAMMPS, or else the nearest known one, was seen to have it."""
        return engine in self.engines or nearest(engine) in self.engines

    def new_on(self, engine: str) -> bool:
        """Return whether a version of LAMMPS is the first to show it: neither it nor the nearest known one had it."""
        return bool(engine and self.engines) and not self.listed(engine)


@dataclass(frozen=True, kw_only=True)
class LawFinding(Finding):
    """A finding in an equation of state; ``variant`` replaces the reference's pressure."""

    variant: Law

    @property
    def named_variant(self) -> str:
        """Return the name of the variant."""
        return self.variant.__name__


@dataclass(frozen=True, kw_only=True)
class ModelFinding(Finding):
    """A finding in the fields of the particle model.

    Attributes
    ----------
    variant : the variant of the reference that reproduces it
    replaces : functions of the reference whose result no case compares, as LAMMPS with this finding has a different one
    expected_in_alarms : restatements of scenes by which the engines differ
    gaps : scenes that the variant is known not to reproduce
    """

    variant: Variant
    replaces: tuple[str, ...] = ()
    expected_in_alarms: tuple[AlarmDifference, ...] = ()
    gaps: tuple[Gap, ...] = ()

    @property
    def model_variant(self) -> Variant:
        """Return the variant of the particle model that reproduces it."""
        return self.variant

    @property
    def named_variant(self) -> str:
        """Return the name of the variant, or the outcome that it predicts."""
        part = self.variant.stages or self.variant.stepping
        return part.__name__ if part else super().named_variant


@dataclass(frozen=True, kw_only=True)
class OutcomeFinding(Finding):
    """A finding that no variant reproduces: it predicts how cases end, or which statement is measured to be wrong.

    Attributes
    ----------
    ends : part of LAMMPS' error on a scene that shows it, whatever its name; empty for others
    refuses : regular expression of LAMMPS' error on decks that show it, followed by the deck's run_style, fixes and
        computes, or of SIGSEGV in its place; empty where the error of a mistake can be the same
    accepts : arguments that the manual forbids and LAMMPS accepts, named as in the reference's input errors
    expected_inputs : bad inputs (ids of the table of `eos-ref stability`) that LAMMPS treats as the finding says
    """

    ends: Callable[[Scene], str] = lambda scene: ""
    refuses: str = ""
    accepts: tuple[str, ...] = ()
    expected_inputs: tuple[str, ...] = ()

    def predicts_of(self, record: CaseRecord, scene: Scene) -> bool:
        """Return whether it predicts, from the scene, how a case of any name ended without numbers."""
        text = self.ends(scene)
        return bool(text) and self.outcome == record.verdict == record.ended and text in record.engine_error
