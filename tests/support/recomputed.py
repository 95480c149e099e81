"""Numbers of findings' texts, recomputed from the expressions in their documents."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.kernels.quintic import normalisation, quintic
from lammps_cases.bugs.report import Demonstration, case_of
from lammps_cases.claims.probes import manual
from lammps_cases.findings import shown_by
from lammps_cases.findings.entry import Finding
from lammps_cases.findings.variants import Snapshot
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from tests.support.printed import Printed
from tests.support.small_scene import Engine, SmallScene, agree

Fields = Callable[[SmallScene], list[Snapshot]]
WORD = re.compile(r"(?<![\w.\"])[A-Za-z]\w*")


def w(r: float, cut: float) -> float:
    """W of the quintic spline in 2D."""
    return float(normalisation(2, cut / 3) * quintic(np.array([3 * r / cut]))[0])


@cache
def probe_of(name: str) -> manual.ManualProbe:
    return next(probe for probe in manual.probes() if probe.id == name)


class Recomputation:
    """What the expressions of a finding's document may use.

    Fields of its scene at the step of its number: ``documented`` by the reference, ``predicted`` with the variants of
    some findings, ``observed`` by LAMMPS as all findings of its version reproduce it, ``agreed`` by LAMMPS as all
    findings but this one do. Each takes changes of the scene. ``probe`` gives the arrays of a probe, ``shortest`` the
    least distance of two particles, ``W`` the kernel.
    """

    def __init__(self, entry: Finding, shown: Demonstration, fields: Fields, version: str, engine: Engine | None):
        self.entry, self.shown, self.version, self.engine = entry, shown, version, engine
        self.fields = cache(lambda text: fields(self.scenes[text]))
        self.scenes: dict[str, SmallScene] = {}

    def small(self, field: str = "", **changes: Any) -> str:
        """The key of the changed scene that compares a field, too, at all of its steps."""
        merged = casefile.merge(self.shown.scene, changes)
        merged["compare"] = merged["compare"] if field in ("", *merged["compare"]) else [field]
        if repr(merged) not in self.scenes:
            case = case_of(self.entry.id, "recomputed", merged)
            steps = tuple(range(case.scene.snapshots[-1] + 1))
            self.scenes[repr(merged)] = SmallScene(case.scene, prepared_case.prepare(case).atoms, steps)
        return repr(merged)

    def at(self, fields: list[Any], field: str) -> Any:
        step = self.shown.number and self.shown.number.step
        return fields[-1 if step is None else step][field]

    def predicted(self, field: str, *findings: str, **changes: Any) -> Any:
        return self.at(self.scenes[self.small(field, **changes)].predicted(*findings).fields, field).astype(float)

    def observed(self, field: str, *, but: str = "", **changes: Any) -> Any:
        name = self.small(field, **changes)
        scene, found = self.scenes[name], self.fields(name)
        acting = [e.id for e in shown_by(scene.problem, self.version, lists=True) if e.id != but]
        predicted = scene.predicted(*acting, snapshot=found[0])
        assert all(agree(found[k][field], predicted, field, k) for k in range(len(found))), (self.entry.id, acting)
        return self.at(found, field)

    def agreed(self, field: str, **changes: Any) -> Any:
        return self.observed(field, but=self.entry.id, **changes)

    def probe(self, name: str) -> Mapping[str, Any]:
        assert self.engine
        reply = self.engine.reply(probe_of(name).base, *probe_of(name).edits)
        assert reply.ended == "answered", reply.error
        return reply.arrays

    def values(self) -> dict[str, list[float]]:
        """What each expression gives, by the names of the numbers."""
        scope: dict[str, Any] = {name: getattr(self, name) for name in ("predicted", "observed", "agreed", "probe")}
        scope |= {"documented": self.predicted, "W": cache(w), "sqrt": np.sqrt, "ptp": np.ptp, "dict": dict, "len": len}
        if self.shown.scene:
            small = self.scenes[self.small()]
            problem = small.problem
            pairs = ArrayEvaluator(problem.model, problem.box, problem.state.type_n, problem.state.solid_n)
            pairs.move(problem.state.x_nc)
            shortest = float(np.asarray(pairs.r).min()) if len(pairs.r) else np.nan
            scope |= {"scene": small.scene, "atoms": small.atoms, "model": problem.model, "shortest": shortest}
        assert not scope.keys() & self.entry.numbers.keys()
        scope |= {name: float(text) for name, text in self.entry.numbers.items()}
        found = {}
        for name, text in self.shown.recomputed.items():
            assert name not in WORD.findall(text), f"{name} from itself"
            values = eval(text, {"__builtins__": {}}, scope)
            found[name] = [x for one in (values if isinstance(values, tuple) else (values,)) for x in np.ravel(one)]
        return found


def from_document(entry: Finding, shown: Demonstration) -> set[str]:
    """The numbers that a document recomputes, and those from which its expressions start."""
    used = {word for text in shown.recomputed.values() for word in WORD.findall(text)}
    return shown.recomputed.keys() | (used & entry.numbers.keys())


def recompute(entry: Finding, shown: Demonstration, fields: Fields, version: str, engine: Engine | None = None) -> None:
    """Check that every number recomputed by a document rounds to the one printed."""
    for name, values in Recomputation(entry, shown, fields, version, engine).values().items():
        number = Printed(entry.numbers[name])
        assert values and all(number.is_rounded(value) for value in values), (entry.id, name, number, values)


def scene_of(name: str, shown: Demonstration, changes: Mapping[str, Any]) -> SmallScene:
    """A changed scene of a finding."""
    case = case_of(name, name, casefile.merge(shown.scene, changes))
    return SmallScene(case.scene, prepared_case.prepare(case).atoms)


def is_documented(fields: list[Snapshot], scene: SmallScene, also: tuple[str, ...]) -> bool:
    """Whether every field lies within its bound of the reference's, at every step that is compared."""
    predicted = scene.predicted(*also)
    return all(agree(at[name], predicted, name, k) for k, at in enumerate(fields) for name in scene.scene.compare)
