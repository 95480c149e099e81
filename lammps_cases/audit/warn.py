"""Questionable set-ups of a deck, by its commands and samples; one plain line with numbers for each.

Only fluid particles are judged: the density of a solid is constructed (by reconstruction, or by a sum over half a
neighbourhood) and may lie anywhere. Only samples that are extreme in some measure of the lines are kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from eos_ref import EOS
from eos_ref.eos.table import FloatArray
from lammps_cases.audit.evaluation import ParticleSample, TimedSample
from lammps_cases.audit.lints import Lint, Stillness, lints
from lammps_cases.findings.outcomes import HYPHEN_RANGE_ACCEPTED
from lammps_cases.studies.stability.advice import judge

DEFAULT_RHO = 1.0  # LAMMPS 22Jul2025's default density of an atom
HYPHEN = HYPHEN_RANGE_ACCEPTED.id
SOLID = 1  # bit of rheo_status
OFFSET = 10  # a pressure is offset if its mean exceeds its range by this factor
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


class _Worst(NamedTuple):
    warns: bool
    measure: float
    line: str
    brief: str


def extremes(sample: ParticleSample) -> dict[str, float]:
    """Return the measures of the lines of a sample; the largest is the worst."""
    model, state = sample.model, sample.state
    fluid_n = ~state.solid_n
    rho_n = state.rho_n[fluid_n] / model.rho0[state.type_n[fluid_n] - 1]
    v_nc, x_nc = state.v_nc[fluid_n], state.x_nc[fluid_n]
    if not len(rho_n):
        return {}
    return {
        "speed": float(np.abs(v_nc).max()),
        "dense": float(rho_n.max()),
        "rare": -float(rho_n.min()),
        "extent": float(np.ptp(x_nc, axis=0).max()),
    }


@dataclass
class Questions:
    """Collects evidence of questionable set-ups; `lines` are the warnings."""

    _rho_set: bool = False
    _types: dict[tuple[int, EOS], _TypeHistory] = field(default_factory=dict)
    _lines: list[str] = field(default_factory=list)
    stillness: Stillness = field(default_factory=Stillness)
    mistaken: bool = False  # whether LAMMPS misreads commands of the deck
    tilted: int = 0  # atoms of a 2D deck with neighbours above or below
    _kept: dict[str, tuple[float, TimedSample]] = field(
        default_factory=dict
    )  # of one model and one time step, by measure
    _worst: dict[str, _Worst] = field(default_factory=dict)  # by subject
    _margins: list[str] = field(default_factory=list)  # of earlier systems
    _ran_away: int | None = None  # last run in which they did

    def note(self, values: list[str]) -> None:
        """Take a command that LAMMPS has executed."""
        if values[0] == "clear":  # another system: the first one ends here
            self._lines = self.lines()
            self._rho_set = False
            self._types.clear()
            self._margins = self.stability
            self._worst.clear()
            self.stillness = Stillness()
        if "property/atom" in values[3:4] and "rmass" in values and ("ghost", "yes") not in pairwise(values):
            self._lines.append(
                f"fix {values[1]} (property/atom rmass): without 'ghost yes' images of particles beyond a boundary "
                "have no masses, and sums over neighbours there are wrong"
            )
        if values[0] in _FROM_FILE or (values[0] == "set" and "rheo/rho" in values):
            self._rho_set = True

    def misread(self, values: list[str], words: list[str]) -> None:
        """Note a command of RHEO's with words that LAMMPS misreads."""
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

    def unprepared(self, run: int, command: str) -> None:
        """Note a run without a set-up that a command before it needs."""
        self._lines.append(
            f"run {run}: 'pre no' leaves out the set-up that {command} before it needs: LAMMPS may keep neighbour "
            "lists and settings of the run before; fields were not checked there"
        )

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

    def look(self, kept: TimedSample) -> None:
        """Keep a sample if it is extreme in some measure, and the first and the last one."""
        last = self._kept.get("last")
        if last is not None and (last[1].sample.model, last[1].timestep) != (kept.sample.model, kept.timestep):
            self._judge()
        for name, measure in {**extremes(kept.sample), "first": 0.0}.items():
            if name not in self._kept or measure > self._kept[name][0]:
                self._kept[name] = measure, kept
        self._kept["last"] = 0.0, kept

    def _judge(self) -> None:
        """Judge the samples that were kept, and discard them."""
        by_step = sorted({(k.run, k.step): k for _, k in self._kept.values()}.items())
        self._kept.clear()
        for (run, step), kept in by_step:
            at = f"run {run}: " if run > 1 else ""
            sample = kept.sample
            for lint in lints(sample, kept.id_n):
                if lint.subject == "weight" and not kept.first:  # of fluid at rest, not of falling drops
                    continue
                self._worse(lint, at, step, True)
            for advice in judge(sample.model, sample.box, sample.state, kept.timestep):
                subject = advice.subject or advice.text
                self._worse(Lint(subject, advice.text, advice.measure), at, step, advice.warns)

    def _worse(self, lint: Lint, run: str, step: int, warns: bool) -> None:
        """Keep a line if it is the worst on its subject."""
        line = f"{run}{lint.line}" + (f" (step {step})" if step else "")
        worst = _Worst(warns, lint.measure, line, lint.brief)
        if lint.subject not in self._worst or worst[:2] > self._worst[lint.subject][:2]:
            self._worst[lint.subject] = worst

    @property
    def stability(self) -> list[str]:
        """The margin to failure, where it is not a warning."""
        self._judge()
        return [*self._margins, *(worst.line for worst in self._worst.values() if not worst.warns)]

    @property
    def brief(self) -> str:
        """The likeliest fault of the set-up, in a few words; empty without one."""
        self._judge()
        order = ("place", "mass", "rho", "weight", "speed", "close")
        found = {subject.split()[0]: worst.brief for subject, worst in self._worst.items() if worst.brief}
        return next((found[subject] for subject in order if subject in found), "")

    def lines(self) -> list[str]:
        """Return the warnings, in the order of systems and types, each once."""
        self._judge()
        own = {subject: worst.line for subject, worst in self._worst.items() if worst.warns}
        lines = [*self._lines, *(line for subject, line in own.items() if not subject.startswith("rho "))]
        for (t, law), history in self._types.items():
            if not law.needs_energy:  # a gas has neither rho0 nor a pressure around 0
                far, unset = own.get(f"rho {t}", ""), _unset(history)
                lines += [far] if far and not unset else []
                questions = [unset] if unset else ["" if far else _unreached(history), _offset(history)]
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
    if not gap > max(rho.width, 1e-6 * rho0):  # margins below the variation of density may be used up in a longer run
        return ""
    return (
        f"rho0 = {rho0:g} was never reached: the density of the fluid stayed within {rho.low:.6g} to {rho.high:.6g} "
        f"in all {history.samples} samples"
    )


def _offset(history: _TypeHistory) -> str:
    p, background = history.p, history.law.background
    natural = 1e-6 * history.law.rho0 * history.law.cs**2  # a smaller pressure is the start of a flow, not an offset
    if not abs(p.mean) > max(OFFSET * p.width, natural):
        return ""
    return (
        f"fixed pressure offset: the pressure of the fluid averages {p.mean:.4g} and varies by only {p.width:.4g} "
        f"({background:.4g} of it is the background, {p.mean - background:.4g} comes from the density)"
    )
