"""Questionable set-ups of a deck, by its commands and samples; one plain line with numbers for each.

Judged by fluid particles only: the density of a solid is constructed (by reconstruction, or by a sum over half a
neighbourhood) and may lie anywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref import EOS
from eos_ref.eos.table import FloatArray
from eos_ref.model.parameters import Model
from lammps_cases.audit.evaluation import ParticleSample
from lammps_cases.audit.lints import Stillness, lints
from lammps_cases.findings.refusals import HYPHEN_RANGE_ACCEPTED
from lammps_cases.studies.stability.advice import judge

DEFAULT_RHO = 1.0  # LAMMPS 22Jul2025's density of an atom for which none is set
HYPHEN = HYPHEN_RANGE_ACCEPTED.id
SOLID = 1  # bit of rheo_status
OFFSET = 10  # a pressure is offset if its mean is this many times its range
_FROM_FILE = frozenset({"read_data", "read_restart", "read_dump"})


@dataclass
class _Range:
    """Smallest and largest value, and the mean, of all samples."""

    low: float = math.inf
    high: float = -math.inf
    total: float = 0.0
    count: int = 0

    def add(self, values_n: FloatArray) -> None:
        self.low = min(self.low, float(values_n.min()))
        self.high = max(self.high, float(values_n.max()))
        self.total += float(values_n.sum())
        self.count += values_n.size

    @property
    def width(self) -> float:
        return self.high - self.low

    @property
    def mean(self) -> float:
        return self.total / self.count


@dataclass
class _TypeHistory:
    """One type under one law."""

    law: EOS
    default: int = 0  # atoms that begin with the default density, if all do
    samples: int = 0
    rho: _Range = field(default_factory=_Range)
    p: _Range = field(default_factory=_Range)


@dataclass
class Questions:
    """Collects evidence of questionable set-ups; `lines` are the warnings."""

    _rho_set: bool = False
    _types: dict[tuple[int, EOS], _TypeHistory] = field(default_factory=dict)
    _far: dict[tuple[int, EOS], str] = field(default_factory=dict)
    _lines: list[str] = field(default_factory=list)
    _said: set[str] = field(default_factory=set)  # subjects of the lints of this system
    stillness: Stillness = field(default_factory=Stillness)
    mistaken: bool = False  # whether LAMMPS takes commands of the deck for something else
    tilted: int = 0  # atoms of a 2D deck with neighbours above or below
    stability: list[str] = field(default_factory=list)  # how far from failing, where that is no warning
    _judged: tuple[Model, float] | None = None
    _ran_away: int | None = None  # run in which they last did

    def note(self, values: list[str]) -> None:
        """Take a command that LAMMPS has executed."""
        if values[0] == "clear":  # another system: the first one ends here
            self._lines = self.lines()
            self._rho_set = False
            self._types.clear()
            self._far.clear()
            self._said.clear()
            self.stillness = Stillness()
        if "property/atom" in values[3:4] and "rmass" in values and ("ghost", "yes") not in pairwise(values):
            self._lines.append(
                f"fix {values[1]} (property/atom rmass): without 'ghost yes' images of particles beyond a boundary "
                "have no masses, and sums over neighbours there are wrong"
            )
        if values[0] in _FROM_FILE or (values[0] == "set" and "rheo/rho" in values):
            self._rho_set = True

    def misread(self, values: list[str], words: list[str]) -> None:
        """Note a command of RHEO's with words that LAMMPS takes for something else."""
        self.mistaken = True
        self._lines += [
            f"fix {values[1]} ({values[3]}): '{word}' is not a valid type range: LAMMPS reads it as "
            f"'{word.partition('-')[0]}' only (known bug {HYPHEN}), and so does this audit; write "
            f"'{word.replace('-', '*')}'"
            for word in words
        ]

    def suffixed(self, styles: list[str]) -> None:
        """Note suffixes that no style of RHEO has."""
        names = " and ".join(f"rheo/{style}" for style in styles)
        self._lines.append(f"suffix {' '.join(styles)}: this LAMMPS has no {names}; RHEO's styles run without it")

    def unwatched(self, run: int) -> None:
        """Note a run without laws."""
        self._lines.append(f"run {run}: no fix rheo/pressure was defined, nothing was checked")

    def run_away(self, run: int, step: int) -> None:
        """Note a sample in which particles are much faster than sound."""
        if self._ran_away != run:
            self._ran_away = run
            self._lines.append(
                f"run {run}: from step {step} on particles are much faster than sound: fields were not checked there"
            )

    def take(self, t: int, law: EOS, status_n: npt.NDArray[Any], rho_n: FloatArray, p_n: FloatArray) -> None:
        """Take density and pressure of all atoms of one type."""
        fluid = status_n & SOLID == 0
        if not fluid.all():
            rho_n, p_n = rho_n[fluid], p_n[fluid]
        if not rho_n.size:
            return
        first = not any(other == t for other, _ in self._types)
        history = self._types.setdefault((t, law), _TypeHistory(law))
        if first and not self._rho_set and bool(np.all(rho_n == DEFAULT_RHO)):
            history.default = rho_n.size
        history.samples += 1
        history.rho.add(rho_n)
        history.p.add(p_n)

    def begin(self, run: int, sample: ParticleSample, timestep: float) -> None:
        """Take the particles at the start of a run; judged once for a model and a time step."""
        model, state = sample.model, sample.state
        if self._judged == (model, timestep):
            return
        prefix = "" if run == 1 else f"run {run}: "
        if self._judged is None or self._judged[0] != model:
            far, warnings = lints(sample)
            self._far |= {(t, model.eos[t]): line for t, line in far.items()}
            self._lines += [prefix + line for subject, line in warnings.items() if subject not in self._said]
            self._said |= warnings.keys()
        self._judged = model, timestep
        for advice in judge(model, sample.box, state, timestep):
            lines = self._lines if advice.warns else self.stability
            lines.append(prefix + advice.text)

    def lines(self) -> list[str]:
        """Return the warnings, in the order of systems and types, each once."""
        lines = list(self._lines)
        for (t, law), history in self._types.items():
            if not law.needs_energy:  # a gas has neither rho0 nor a pressure around 0
                off = self._far.get((t, law)) or _unreached(history)
                questions = [_unset(history)] if _unset(history) else [off, _offset(history)]
                lines += [f"type {t}: {line}" for line in questions if line]
        if self.stillness.line:
            lines.append(self.stillness.line)
        if self.tilted:
            lines.append(
                f"{self.tilted} atoms of this 2D deck have neighbours at another height z: LAMMPS takes distances in "
                "space; fields of these atoms and their neighbours were not checked"
            )
        return list(dict.fromkeys(lines))


def _unset(history: _TypeHistory) -> str:
    law = history.law
    if not history.default or law.rho0 == DEFAULT_RHO:
        return ""
    return (
        f"rho was never set: all {history.default} fluid atoms begin with the default density {DEFAULT_RHO:g} while "
        f"rho0 = {law.rho0:g}, so their pressure begins at {float(law.pressure(DEFAULT_RHO)):.4g}"
    )


def _unreached(history: _TypeHistory) -> str:
    rho, rho0 = history.rho, history.law.rho0
    gap = max(rho.low - rho0, rho0 - rho.high)
    if not gap > max(rho.width, 1e-6 * rho0):  # nearer than the density varies, a longer run may reach it
        return ""
    return (
        f"rho0 = {rho0:g} was never reached: the density of the fluid stayed within {rho.low:.6g} to {rho.high:.6g} "
        f"in all {history.samples} samples"
    )


def _offset(history: _TypeHistory) -> str:
    p, background = history.p, history.law.background
    natural = 1e-6 * history.law.rho0 * history.law.cs**2  # a smaller pressure is no offset but the start of a flow
    if not abs(p.mean) > max(OFFSET * p.width, natural):
        return ""
    return (
        f"fixed pressure offset: the pressure of the fluid averages {p.mean:.4g} and varies by only {p.width:.4g} "
        f"({background:.4g} of it is the background, {p.mean - background:.4g} comes from the density)"
    )
