"""Which findings explain a difference, for findings made by hand: each changes some values of the reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.box import Box
from lammps_cases import findings
from lammps_cases.comparison.predictor import Made, Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.comparison.trajectory import Fields, Prediction
from lammps_cases.findings import KNOWN, LEDGER, NEWEST, Finding
from lammps_cases.findings.variants import Snapshot, Variant
from lammps_cases.records.case_parts import Beyond, DigitsLost
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict import particle_model
from lammps_cases.verdict.particle_model import ModelVerdict, Reason
from tests.support import made_findings

NAN, INF = float("nan"), float("inf")
ID = np.array([8, 5, 3])
FIXED = SimpleNamespace(deform=None)  # the only property read from a model: whether its box grows
PROBLEM = Problem(FIXED, None, None, 0.0, ("f", "coordination"), (0, 2, 5))  # coordination precedes f in a step
REFERENCE = 10.0
Bounds = tuple[float, float, float]
Effects = Mapping[str, tuple[int, str, float]]  # step, field and distance from the reference, by findings


class Played(Predictor):
    """Predictions of the reference changed by findings; the bounds of three values are 1, or those of ``bounds``."""

    def __init__(
        self, effects: Effects, bounds: Mapping[str, Bounds], without_bound: Mapping[str, Mapping[int, str]]
    ) -> None:
        super().__init__()
        self.effects, self.bounds, self.without_bound = effects, bounds, without_bound
        self.asked: list[tuple[str, tuple[int, ...]]] = []
        self.widened: list[tuple[tuple[int, ...], float]] = []  # steps, and fraction of the bounds
        self.told: list[Snapshot] = []  # output of LAMMPS

    def fields(self, problem: Problem, names: frozenset[str]) -> tuple[Fields, ...]:
        numbers = {field: int(REFERENCE) if field == "coordination" else REFERENCE for field in problem.fields}
        made = tuple({field: np.full(3, number) for field, number in numbers.items()} for _ in problem.steps)
        for together, (step, field, moved) in self.effects.items():
            if set(together.split("+")) <= names and step in problem.steps:
                made[problem.steps.index(step)][field][1] += moved
        return made

    def predict(self, problem: Problem, made: Made | None = None, seed: int = 0) -> Prediction:
        stages = made[0].__mro__ if made else ()
        names = frozenset(stage.__name__ for stage in stages if stage.__module__ == __name__)
        assert names or made is None, "the reference itself is not tried again"
        assert seed == SEED, "the moved runs of a variant are those of the case"
        self.asked.append(("+".join(sorted(names)), problem.steps))
        if names & {"runaway", "RUNAWAY"}:
            raise InputError("density", "must be finite", NAN)
        bound_n = np.array(self.bounds.get("+".join(sorted(names)), (1.0, 1.0, 1.0)))
        bounds = tuple(dict.fromkeys(problem.fields, bound_n) for _ in problem.steps)
        for name in names & set(self.without_bound):
            for step, field in self.without_bound[name].items():
                if step in problem.steps:
                    bounds[problem.steps.index(step)][field] = np.full(3, INF)
        return Prediction(self.fields(problem, names), bounds)

    def widening(self, problem: Problem, made: Made, seed: int) -> Iterator[Prediction]:
        whole = self.predict(problem, made, seed)
        for part in (0.5, 1.0):
            self.widened.append((problem.steps, part))
            yield replace(whole, bounds=tuple({f: part * bound[f] for f in bound} for bound in whole.bounds))

    def values(self, problem: Problem, made: Made) -> list[Fields]:
        assert made, "what cannot be fitted has none"
        return list(self.predict(problem, made, SEED).fields)

    def precise(self, problem: Problem) -> Fields:
        return {field: np.full(3, np.longdouble(REFERENCE)) for field in problem.fields}

    def names(self, what: str, problem: Problem, compute: Callable[[], list[str]], seed: int) -> list[str]:
        assert (what, seed) == ("unseen", SEED)
        return compute()


SEED = seed("a.case/moved runs")


def finding(name: str, number: int, on: Finding | None = None, **variant: Any) -> Finding:
    """Return a finding, optionally built on another, observed on the oldest LAMMPS (capitals) or the newest."""
    stages = type(name, (on.model_variant.stages if on else ArrayEvaluator,), {"__module__": __name__})
    engines = (KNOWN[0] if name.isupper() else NEWEST,)
    made = Variant(lambda problem: True, stages, **variant)
    return made_findings.finding(name, number, engines=engines, model=made)


def mistakes(problem: Problem, prediction: Prediction) -> list[str]:
    assert len(problem.steps) == len(prediction.fields)
    return ["a mistake"]


@pytest.fixture
def judge(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[ModelVerdict, Played]]:
    """Judge a LAMMPS with the effects of some findings, and other deviations."""

    def judged(
        has: str,
        effects: Effects,
        *also: tuple[Any, ...],
        settings: Mapping[str, dict[str, Any]] = MappingProxyType({}),
        bounds: Mapping[str, Bounds] = MappingProxyType({}),
        without_bound: Mapping[str, Mapping[int, str]] = MappingProxyType({}),
        lists: bool = False,
        of: Problem = PROBLEM,
    ) -> tuple[ModelVerdict, Played]:
        names = list(dict.fromkeys(name for together in effects for name in together.split("+")))
        entries: dict[str, Finding] = {}
        for number, name in enumerate(names):
            special = dict(settings.get(name, {}))
            entries[name] = finding(name, number, entries.get(special.pop("on", "")), **special)
        monkeypatch.setattr(findings, "LEDGER", (LEDGER[0], *entries.values()))
        predictor = Played(effects, bounds, without_bound)
        predictor.told = list(predictor.fields(of, frozenset(has.split("+"))))
        for step, field, moved, *row in also:
            predictor.told[of.steps.index(step)][field][row or 1] += moved
        if lists:
            predictor.told[0]["lists"] = ()
        monkeypatch.setattr(particle_model, "undetected_in_model", mistakes)
        return particle_model.compare_and_explain(of, "a.case", ID, predictor.told, KNOWN[0], predictor), predictor

    return judged


def explained(verdict: ModelVerdict) -> list[str]:
    return [entry.id for entry in verdict.entries]


def unseen(verdict: ModelVerdict) -> list[str]:
    return [entry.id for entry in verdict.unseen]


def verdicts(verdict: ModelVerdict) -> dict[str, str]:
    return {comparison.record.field: comparison.record.verdict for comparison in verdict.comparisons}


FORCE, COUNT = (2, "f", 4.0), (5, "coordination", 4.0)


# --- explanations


@pytest.mark.parametrize(
    ("has", "effects", "explanation"),
    [
        ("A", {"A": FORCE, "B": COUNT}, ["A"]),
        ("A+B", {"A": FORCE, "B": COUNT}, ["A", "B"]),
        ("A+B", {"A": FORCE, "B": COUNT, "C": (2, "f", 0.5)}, ["A", "B"]),
        ("A+b", {"A": FORCE, "b": COUNT}, ["A", "b"]),
        ("A", {"A": FORCE, "B": (2, "f", 0.5)}, ["A"]),  # B is within the bound: it is not needed
        ("b", {"A": FORCE, "b": COUNT}, ["b"]),
        ("a+b", {"a": FORCE, "b": COUNT, "c": (0, "f", 4.0)}, ["a", "b"]),
        ("c", {"a": FORCE, "b": COUNT, "c": FORCE, "a+b": COUNT}, ["a"]),  # equal effects: the first of the ledger
        ("a", {"a": FORCE, "B": FORCE, "C": COUNT}, ["B"]),  # equal effects: the one that the engine is known to have
        ("a+b", {"a": (2, "f", 0.4), "b": (2, "f", 0.3), "a+b": FORCE}, ["a", "b"]),  # visible only in combination
        ("a", {"a": FORCE, "a+b": COUNT, "b": (0, "f", 0.5)}, ["a"]),
        ("a", {"b": COUNT, "a": FORCE, "c": (0, "f", 4.0)}, ["a"]),
        ("A", {"A": FORCE, "b": COUNT, "A+b": (2, "f", -4.0)}, ["A"]),
    ],
)
def test_smallest_set_that_reproduces_every_value_explains(
    judge: Any, has: str, effects: Effects, explanation: list[str]
) -> None:
    verdict, _ = judge(has, effects)
    assert explained(verdict) == explanation and verdict.beyond is None
    assert verdict.first is not None
    for comparison in verdict.comparisons:
        red = comparison.record.verdict == "explained"
        assert comparison.record.explained_by == (explanation if red else [])
    moved = {field for name in has.split("+") for _, field, by in [effects.get(name, FORCE)] if abs(by) > 1}
    assert {field for field, of in verdicts(verdict).items() if of == "explained"} == (moved or {"f"})


def test_nothing_is_tried_without_a_difference(judge: Any) -> None:
    verdict, predictor = judge("", {"a": FORCE, "b": COUNT})
    assert verdicts(verdict) == {"coordination": "exact", "f": "exact"}
    assert (verdict.entries, verdict.first, verdict.unseen) == ([], None, [])
    assert set(predictor.asked) == {("", PROBLEM.steps)}


def test_most_sets_fail_at_the_first_step(judge: Any) -> None:
    """The later steps of a run are not predicted for them."""
    _, predictor = judge("a", {"a": FORCE, "b": COUNT}, (0, "f", 4.0))
    assert {steps for names, steps in predictor.asked if "+" in names} == {(0,)}


def test_known_findings_of_the_engine_are_tried_at_all_steps_at_once(judge: Any) -> None:
    _, predictor = judge("A+B", {"A": FORCE, "B": COUNT})
    assert {steps for names, steps in predictor.asked if names == "A+B"} == {PROBLEM.steps}


@pytest.mark.parametrize(("off", "explanation"), [(1.0, ["a"]), (1.5, [])])
def test_variant_reproduces_lammps_within_its_bound(judge: Any, off: float, explanation: list[str]) -> None:
    verdict, _ = judge("a", {"a": FORCE}, (2, "f", off))
    assert explained(verdict) == explanation


@pytest.mark.parametrize(("off", "parts"), [(0.4, [0.5]), (0.6, [0.5, 1.0]), (1.5, [0.5, 1.0])])
def test_full_bounds_are_computed_only_if_partial_ones_are_exceeded(judge: Any, off: float, parts: list[float]) -> None:
    _, predictor = judge("A", {"A": FORCE}, (2, "f", off))
    tried = [part for steps, part in predictor.widened if steps == PROBLEM.steps]
    assert tried[: len(parts)] == parts and (len(tried) == len(parts) or off > 1)


@pytest.mark.parametrize(
    ("effect", "moved", "explanation"),
    [
        (NAN, NAN, ["a"]),
        (NAN, 4.0, []),  # a number where the variant has NaN
        (4.0, NAN, []),  # NaN where the variant has a number
    ],
)
def test_nan_is_reproduced_only_by_nan(judge: Any, effect: float, moved: float, explanation: list[str]) -> None:
    verdict, _ = judge("", {"a": (2, "f", effect)}, (2, "f", moved))
    assert explained(verdict) == explanation


def test_finding_with_an_effect_within_the_bound_explains_nothing(judge: Any) -> None:
    """This holds even if it brings the reference closer to LAMMPS."""
    verdict, _ = judge("", {"a": (2, "f", 0.5)}, (2, "f", 1.25))
    assert explained(verdict) == []


def test_positions_wrapped_by_lammps_are_reproduced(judge: Any) -> None:
    of = replace(PROBLEM, fields=("x",), box=Box((0.0,) * 3, (40.0,) * 3, (True,) * 3))  # each value along its axis
    verdict, _ = judge("a", {"a": (2, "x", 4.0)}, (2, "x", -40.0), of=of)
    assert explained(verdict) == ["a"]


# --- remaining differences


@pytest.mark.parametrize(
    ("has", "effects", "own", "beyond"),
    [
        ("a", {"a": FORCE}, COUNT, (["a"], 5, "coordination")),
        ("a", {"a": (2, "coordination", 4.0)}, FORCE, (["a"], 2, "f")),
        ("A", {"A": FORCE, "B": (2, "f", 0.5)}, COUNT, (["A"], 5, "coordination")),  # B is known, and has no effect
        ("A+B", {"A": FORCE, "B": (5, "f", 4.0)}, COUNT, (["A"], 5, "coordination")),  # B follows the difference
        ("A+B", {"A": FORCE, "B": (0, "f", 4.0)}, COUNT, (["A", "B"], 5, "coordination")),
        ("a", {"a": FORCE, "b": (5, "f", 4.0)}, COUNT, (["a"], 5, "coordination")),  # the smallest set
        ("a", {"a": FORCE, "b": FORCE}, COUNT, (["a"], 5, "coordination")),  # equal effects: the first of the ledger
        ("a+b", {"b": (0, "f", 4.0), "a": FORCE}, COUNT, (["b", "a"], 5, "coordination")),
        ("a", {"a": COUNT, "b": (0, "f", 4.0)}, (2, "coordination", 4.0), None),  # no finding reaches a later step
        ("A", {"A": COUNT}, (2, "coordination", 4.0), ([], 2, "coordination")),  # nor do known ones
        ("", {}, FORCE, None),
    ],
)
def test_remaining_difference_is_named_with_the_furthest_findings(
    judge: Any, has: str, effects: Effects, own: tuple[int, str, float], beyond: tuple[list[str], int, str] | None
) -> None:
    verdict, _ = judge(has, effects, own)
    assert explained(verdict) == [] and "explained" not in verdicts(verdict).values()
    assert "differs" in verdicts(verdict).values() and verdict.first is not None
    left = verdict.beyond
    assert (left and (left.findings, left.blame.step, left.blame.field)) == beyond
    if left:
        assert (left.blame.atom, left.blame.lammps) == (5, REFERENCE + own[2])


@pytest.mark.parametrize("open_at", [0, 2])
@pytest.mark.parametrize(
    ("own", "left"),
    [
        ((2, "f", 0.0), None),
        ((2, "f", 4.0), (2, "f", 1.0)),
        ((5, "f", 4.0), (5, "f", 1.0)),  # at a later step, too
    ],
)
def test_unbounded_value_is_blamed_if_all_bounded_ones_are_inside(
    judge: Any, open_at: int, own: tuple[int, str, float], left: tuple[int, str, float] | None
) -> None:
    """A set that leaves only unbounded values outside reaches further than one that leaves a bounded field outside."""
    open_after = {"a": {open_at: "coordination"}}
    effects = {"a": (open_at, "coordination", 4.0), "b": (0, "f", 4.0)}
    verdict, _ = judge("a", effects, own, without_bound=open_after)
    assert verdict.beyond is not None and verdict.beyond.findings == ["a"]
    blame = verdict.beyond.blame
    assert (blame.step, blame.field, blame.bound) == (left or (open_at, "coordination", INF))


def test_bounded_values_of_the_reference_are_blamed_first(judge: Any) -> None:
    bounds = {"": (INF, 1.0, 1.0)}
    assert judge("", {}, bounds=bounds)[0].first.bound == INF
    first = judge("", {}, (5, "f", 4.0), bounds=bounds)[0].first
    assert (first.step, first.field, first.atom, first.outside) == (5, "f", 5, 1)


# --- special variants


def test_variant_is_fitted_to_the_first_snapshot_of_lammps(judge: Any) -> None:
    given = []

    def fit(problem: Problem, stages: type[ArrayEvaluator], snapshot: Snapshot) -> dict[str, Any]:
        given.append((problem.fields, problem.steps[0], stages.__name__, snapshot["f"][1]))
        return {}

    verdict, _ = judge("a", {"a": (0, "f", 4.0)}, settings={"a": {"fit": fit}})
    assert explained(verdict) == ["a"]
    assert set(given) == {(PROBLEM.fields, 0, "Evaluator", REFERENCE + 4.0)}


@pytest.mark.parametrize("undefined", [True, False])
@pytest.mark.parametrize("settings", [{}, {"fit": lambda *given: None}], ids=["runs away", "does not fit"])
def test_variant_that_predicts_nothing_explains_nothing(judge: Any, settings: dict[str, Any], undefined: bool) -> None:
    none = {"runaway": settings | {"undefined": undefined}}
    verdict, predictor = judge("runaway", {"runaway": FORCE, "b": COUNT}, settings=none)
    assert (explained(verdict), verdict.beyond) == ([], None)
    assert ("", (0,)) not in predictor.asked, "nor the reference in its place"
    assert explained(judge("b", {"runaway": FORCE, "b": COUNT}, settings=none)[0]) == ["b"]
    known, _ = judge("", {"RUNAWAY": FORCE}, COUNT, settings={"RUNAWAY": none["runaway"]})
    assert known.beyond is None, "with it as without it"


NO_BOUND = (1.0, INF, 1.0)  # for the middle particle, which findings change


@pytest.mark.parametrize(
    ("undefined", "own", "of_variant", "beside", "explanation"),
    [
        (True, (1.0,) * 3, NO_BOUND, 0.0, ["a"]),
        (True, (1.0,) * 3, NO_BOUND, 1.0, ["a"]),
        (True, (1.0,) * 3, NO_BOUND, 1.5, []),  # a bounded value is outside
        (False, (1.0,) * 3, NO_BOUND, 0.0, []),
        (True, (1.0,) * 3, (INF,) * 3, 0.0, ["a"]),  # a field with nothing left to compare
        (True, NO_BOUND, NO_BOUND, 0.0, []),  # the reference itself has no bound
        (True, (1.0,) * 3, (1.0,) * 3, 0.0, []),
    ],
)
def test_variant_may_leave_values_without_a_bound(
    judge: Any, undefined: bool, own: Bounds, of_variant: Bounds, beside: float, explanation: list[str]
) -> None:
    settings, bounds = {"a": {"undefined": undefined}}, {"": own, "a": of_variant}
    verdict, _ = judge("a", {"a": FORCE}, (2, "f", 30.0), (2, "f", beside, 0), settings=settings, bounds=bounds)
    assert explained(verdict) == explanation
    said = "not predictable in steps 0 to 5, because of the known bug a"
    assert verdict.unpredictable == (dict.fromkeys(PROBLEM.fields[::-1], said) if of_variant == (INF,) * 3 else {})


@pytest.mark.parametrize(
    ("of_variant", "off", "blamed"),
    [
        ((INF, 1.0, 1.0), 1.5, (3, 1.0, 1)),
        ((INF, 1.0, 1.0), 1.0, (8, INF, 1)),  # a value at its bound is inside
        ((1.0,) * 3, 1.5, (3, 1.0, 1)),
    ],
)
def test_bounded_value_is_blamed_before_an_unbounded_one(
    judge: Any, of_variant: Bounds, off: float, blamed: tuple[int, float, int]
) -> None:
    settings, bounds = {"A": {"undefined": off > 1}}, {"A": of_variant}
    of = replace(PROBLEM, fields=("f",))
    verdict, _ = judge("A", {"A": (0, "f", 4.0)}, (2, "f", off, 2), settings=settings, bounds=bounds, of=of)
    blame = verdict.beyond.blame
    assert (blame.atom, blame.bound, blame.outside) == blamed


def test_blame_has_the_lowest_id_outside_and_both_sides(judge: Any) -> None:
    blame = judge("", {}, (2, "f", 1.0, 2), (2, "f", 4.0, 1), (2, "f", 3.0, 0))[0].first
    assert (blame.atom, blame.lammps, blame.reference, blame.bound) == (5, REFERENCE + 4.0, REFERENCE, 1.0)
    assert (blame.field, blame.stage, blame.outside, blame.of) == ("f", FIELDS["f"].stage, 2, 3)


@pytest.mark.parametrize(("lists", "explanation"), [(True, ["A"]), (False, [])])
@pytest.mark.parametrize("of", [PROBLEM, replace(PROBLEM, steps=(2,))])
def test_findings_that_depend_on_neighbour_lists_need_them(
    judge: Any, of: Problem, lists: bool, explanation: list[str]
) -> None:
    follows = {"A": {"lists": True}}
    assert explained(judge("A", {"A": FORCE}, settings=follows, lists=lists, of=of)[0]) == explanation
    assert explained(judge("a", {"a": FORCE}, settings={"a": follows["A"]}, lists=lists, of=of)[0]) == (
        ["a"] if lists else []
    )
    assert unseen(judge("", {"A": FORCE}, settings=follows, lists=lists, of=of)[0]) == explanation
    known, _ = judge("A", {"b": FORCE, "A": FORCE}, settings=follows, lists=lists, of=of)
    assert explained(known) == (explanation or ["b"]), "one known of the engine comes first"


# --- other findings


@pytest.mark.parametrize(
    ("has", "also", "names"),
    [
        ("", (), ["A", "B", "E"]),  # all known findings of the engine are absent
        ("A", (), ["B", "E"]),
        ("A+B+E", (), []),
        ("a", (), ["A", "B", "E"]),
        ("", ((2, "coordination", 4.0),), []),  # nothing is reported for a difference without an explanation
    ],
)
def test_absent_known_findings_that_would_show_are_named(judge: Any, has: str, also: Any, names: list[str]) -> None:
    """Excluded are findings whose effect is at the bound, that diverge or that cannot be fitted."""
    effects = {"A": FORCE, "B": COUNT, "C": (2, "f", 1.0), "a": (0, "f", 4.0), "RUNAWAY": FORCE, "D": FORCE}
    effects["E"] = (5, "f", 1.5)
    verdict, _ = judge(has, effects, *also, settings={"D": {"fit": lambda *given: None}})
    assert unseen(verdict) == names


def test_known_finding_that_another_builds_on_is_not_absent(judge: Any) -> None:
    verdict, _ = judge("B+c", {"B": FORCE, "c": COUNT, "D": FORCE}, settings={"c": {"on": "B"}})
    assert (explained(verdict), unseen(verdict)) == (["c"], ["D"])


def test_digits_lost_are_those_of_the_first_evaluation(judge: Any) -> None:
    """Those of LAMMPS are reported only if it evaluates the same formula."""
    lost = {
        moved: {c.record.field: c.record.digits_lost for c in judge("", {}, (0, "f", moved))[0].comparisons}
        for moved in (0.5, 4.0)
    }
    assert lost[0.5]["f"] == DigitsLost(lammps=round(np.log10(0.05 / EPS), 2), reference=0.0)
    assert lost[4.0]["f"] == DigitsLost(reference=0.0)
    assert lost[4.0]["coordination"] == DigitsLost(lammps=0.0, reference=0.0)


def test_run_compared_later_has_neither_digits_nor_a_lint(judge: Any) -> None:
    first, _ = judge("", {})
    later, _ = judge("", {}, of=replace(PROBLEM, steps=(2, 5)))
    assert (first.lint, later.lint) == (["a mistake"], [])
    assert {comparison.record.digits_lost.reference for comparison in first.comparisons} == {0.0}
    assert {comparison.record.digits_lost.reference for comparison in later.comparisons} == {None}


@pytest.mark.parametrize(
    ("values", "exact", "lost"),
    [
        ([1.0, 2.0], [1.0, 2.0], 0.0),
        ([1.0, 2.0 + 2e-9], [1.0, 2.0], np.log10(1e-9 / EPS)),  # the worst value
        ([[3.0, 1e-9], [5.0, 0.0]], [[3.0, 0.0], [5.0, 0.0]], np.log10(1e-9 / 3 / EPS)),  # relative to its row
        ([1.0, 1e-300], [1.0, 0.0], 99.0),
        ([1.0, 0.0], [1.0, 0.0], 0.0),
        ([1.0 + EPS / 2], [1.0], 0.0),
    ],
)
def test_digits_lost_are_those_of_the_worst_row(values: Any, exact: Any, lost: float) -> None:
    assert particle_model.digits(np.array(values), np.array(exact, np.longdouble)) == round(lost, 2)


# --- the first difference of an answer read at every step


def test_reason_is_the_first_difference_and_the_unexplained_rest(judge: Any) -> None:
    verdict, predictor = judge("a", {"a": FORCE}, COUNT)
    found = particle_model.reason(PROBLEM, "a.case", ID, predictor.told, KNOWN[0], predictor)
    assert found == Reason(verdict.first, verdict.beyond) and verdict.beyond is not None
    verdict, predictor = judge("", {"a": COUNT}, (2, "coordination", 4.0))
    found = particle_model.reason(PROBLEM, "a.case", ID, predictor.told, NEWEST, predictor)
    assert verdict.beyond is None and found == Reason(
        verdict.first, Beyond(findings=[], blame=verdict.first, known=["a"])
    )
    right = predictor.fields(PROBLEM, frozenset())
    assert particle_model.reason(PROBLEM, "a.case", ID, right, NEWEST, predictor) is None
