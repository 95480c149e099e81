"""Whether one engine is slower than another: measured in turns, or by the single calls of saved runs."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Literal

from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import Job
from lammps_cases.engine.workers import Failure, Workers, solve
from lammps_cases.records.measure import ROUNDS, Answer, ConfidenceInterval, Timing, interval, verdict
from lammps_cases.records.progress import SILENT, Progress
from lammps_cases.scene.atoms import build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.chart.bench import OPTIONS, scene
from lammps_cases.versions.outcomes import Side

EDGE, STEPS = 40, 10  # 1600 particles: a run of 50 to 150 ms, of which the set-up is a few per cent
LIMIT = 120.0  # seconds for a single run
TOTAL = "all together"


@dataclass(frozen=True)
class Speed:
    """Time of B over that of A.

    Attributes
    ----------
    how : measured in turns, or each case called once on each side
    count : rounds, or cases
    answer : whether B is slower; of a single scene only if all rounds agree, as one of many intervals of 95 %
        occasionally misses 1 by chance (all of nine rounds on one side of the median: 0.4 %)
    """

    scene: str
    how: Literal["in turns", "single calls"]
    count: int
    ratio: ConfidenceInterval
    answer: Answer

    def sentence(self, a: str = "A", b: str = "B") -> str:
        """Describe the ratio in one line, with the names of the sides."""
        r = self.ratio
        verdict_on_b = self.answer if self.answer == "cannot tell" else f"{b} is {self.answer}"
        each = f"{self.count} rounds in turns"
        if self.how == "single calls":
            each = f"single calls of {self.count} cases, under whatever load the machine had"
        return (
            f"time of {b} over {a}, {self.scene}: {r.median:.3f} [{r.low:.3f}, {r.high:.3f}] ({each}): {verdict_on_b}"
        )


def of_saved(a: Side, b: Side) -> Speed | None:
    """Compare LAMMPS' seconds over the cases that both sides answered; None without such cases.

    Each case was called once on each side, at another time. The interval (the same for the ratios and for their
    logarithms) covers the scatter of cases, not the load of the machine, and cannot show that a side is slower.
    """
    names = sorted(name for name in a.cases.keys() & b.cases.keys() if _timed(a, name) and _timed(b, name))
    if not names:
        return None
    ratio = interval(tuple(b.cases[name].seconds / a.cases[name].seconds for name in names))
    return Speed("LAMMPS", "single calls", len(names), ratio, "cannot tell")


def _timed(side: Side, name: str) -> bool:
    return side.cases[name].ended == "answered" and side.cases[name].seconds > 0


@dataclass(frozen=True)
class Turns:
    """Wall times of LAMMPS' run commands, of every engine on every scene, in the same rounds."""

    seconds: Mapping[tuple[str, str], tuple[float, ...]]  # by scene and engine

    def against(self, one: str, other: str) -> list[Speed]:
        """Return the time of the second engine over that of the first, on all and each scene; empty if one failed."""
        scenes = list(dict.fromkeys(scene for scene, _ in self.seconds))
        speeds = []
        for name in scenes:
            a, b = self.seconds[name, one], self.seconds[name, other]
            ratio = Timing(b, 1, 0.0).against(Timing(a, 1, 0.0))
            ratios = [after / before for after, before in zip(b, a, strict=True)]
            decides = ratio if name == TOTAL else ConfidenceInterval(ratio.median, min(ratios), max(ratios))
            speeds.append(Speed(name, "in turns", len(a), ratio, verdict(decides)))
        return speeds


def scenes() -> list[Case]:
    """Return the timed scenes: fluids with every option that changes LAMMPS' work."""
    cases = []
    for option in OPTIONS:
        case = scene(option, 2, EDGE)
        evolve = case.scene.evolve
        assert evolve is not None
        longer = evolve.model_copy(update={"steps": STEPS, "compare_at": None})
        cases.append(Case(option, "", (), case.scene.model_copy(update={"evolve": longer}), case.source))
    return cases


def in_turns(engines: Mapping[str, Engine], rounds: int = ROUNDS, progress: Progress = SILENT) -> Turns | None:
    """Time engines, one running LAMMPS each, in rounds of rotating order; None if one of them fails on a scene.

    The wall time is that of the run commands alone, taken inside LAMMPS' process.
    """
    jobs = {case.name: job(case.scene, build(case, case.scene.eos()), plan(case.scene)) for case in scenes()}
    names, total = list(engines), (rounds + 1) * len(jobs)
    seconds: dict[tuple[str, str], list[float]] = {}
    with ExitStack() as stack:
        workers = {name: stack.enter_context(Workers(engine.site, 1)) for name, engine in engines.items()}
        for turn in range(rounds + 1):  # the first warms up
            start = turn % len(names)
            order = (names[start:] + names[:start])[:: 1 if turn % 2 == 0 else -1]
            for at, (scene_name, lammps_job) in enumerate(jobs.items()):
                for name in order:
                    answer = workers[name].outcome(workers[name].call(spent, lammps_job, time_limit=LIMIT))
                    if isinstance(answer, Failure):
                        return None
                    if turn:
                        seconds.setdefault((scene_name, name), []).append(answer)
                progress.advance(turn * len(jobs) + at + 1, total, f"timing {scene_name}")
    each = {key: tuple(values) for key, values in seconds.items()}
    sums = {
        (TOTAL, name): tuple(sum(row) for row in zip(*(each[s, name] for s in jobs), strict=True)) for name in names
    }
    return Turns(sums | each)


def spent(site: str | None, lammps_job: Job) -> float:
    """Task: return the seconds that LAMMPS' run commands take."""
    return sum(solve(site, lammps_job).run_seconds)
