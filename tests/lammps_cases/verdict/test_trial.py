"""Which findings explain a difference, for findings made by hand: each changes some values of the reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from types import SimpleNamespace
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
from lammps_cases.records.case_parts import Beyond, Blame, DigitsLost
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict import particle_model
from lammps_cases.verdict.particle_model import ModelVerdict, Reason
from tests.support import made_findings

NAN, INF = float("nan"), float("inf")
ID, SEED = np.array([8, 5, 3]), seed("a.case/moved runs")
FIXED = SimpleNamespace(deform=None)  # the only property read from a model: whether its box grows
PROBLEM = Problem(FIXED, None, None, 0.0, ("f", "coordination"), (0, 2, 5))  # coordination precedes f in a step
REFERENCE = 10.0
Effect = tuple[int, str, float]  # step, field and distance from the reference
Effects = Mapping[str, Effect]  # by findings
Bounds = tuple[float, float, float]
FORCE, COUNT = (2, "f", 4.0), (5, "coordination", 4.0)


class Played(Predictor):
    """Predictions of the reference changed by findings; the bounds of three values are 1, or those of ``bounds``."""

    def __init__(
        self, effects: Effects, bounds: Mapping[str, Bounds], without_bound: Mapping[str, Mapping[int, str]]
    ) -> None:
        super().__init__()
        self.effects, self.bounds, self.without_bound = effects, bounds, without_bound
        self.asked: list[tuple[str, tuple[int, ...]]] = []
        self.widened: list[tuple[tuple[int, ...], float]] = []  # steps, and fraction of the bounds
        self.lammps: list[Snapshot] = []  # its output

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
        together = "+".join(sorted(names))
        self.asked.append((together, problem.steps))
        if names & {"runaway", "RUNAWAY"}:
            raise InputError("density", "must be finite", NAN)
        bound_n = np.array(self.bounds.get(together, (1.0, 1.0, 1.0)))
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
        return ["a mistake"]


@pytest.fixture
def judge(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[ModelVerdict, Played]]:
    """Judge a LAMMPS with the effects of some findings, and other deviations.

    Findings named in capitals are those that the oldest LAMMPS is known to have, others are known of the newest.
    """

    def judged(
        has: str,
        effects: Effects,
        *also: tuple[Any, ...],
        settings: Mapping[str, Mapping[str, Any]] | None = None,
        bounds: Mapping[str, Bounds] | None = None,
        without_bound: Mapping[str, Mapping[int, str]] | None = None,
        lists: bool = False,
        of: Problem = PROBLEM,
    ) -> tuple[ModelVerdict, Played]:
        entries: dict[str, Finding] = {}
        for number, name in enumerate(dict.fromkeys(name for together in effects for name in together.split("+"))):
            special = dict((settings or {}).get(name, {}))
            base = entries[special.pop("on")].model_variant.stages if "on" in special else ArrayEvaluator
            variant = Variant(lambda problem: True, type(name, (base,), {"__module__": __name__}), **special)
            known = (KNOWN[0] if name.isupper() else NEWEST,)
            entries[name] = made_findings.finding(name, number, engines=known, model=variant)
        monkeypatch.setattr(findings, "LEDGER", (LEDGER[0], *entries.values()))
        predictor = Played(effects, bounds or {}, without_bound or {})
        predictor.lammps = list(predictor.fields(of, frozenset(has.split("+"))))
        for step, field, moved, *row in also:
            predictor.lammps[of.steps.index(step)][field][row or 1] += moved
        if lists:
            predictor.lammps[0]["lists"] = ()
        return particle_model.compare_and_explain(of, "a.case", ID, predictor.lammps, KNOWN[0], predictor), predictor

    return judged


def ids(entries: list[Finding]) -> list[str]:
    return [entry.id for entry in entries]


def explained(judged: tuple[ModelVerdict, Played]) -> list[str]:
    return ids(judged[0].entries)


def place(blame: Blame) -> tuple[int | None, str]:
    return blame.step, blame.field


# --- explanations


@pytest.mark.parametrize(
    ("has", "effects", "also", "explanation"),
    [
        ("A", {"A": FORCE, "B": COUNT}, None, ["A"]),
        ("A+B", {"A": FORCE, "B": COUNT}, None, ["A", "B"]),
        ("A+B", {"A": FORCE, "B": COUNT, "C": (2, "f", 0.5)}, None, ["A", "B"]),
        ("A+b", {"A": FORCE, "b": COUNT}, None, ["A", "b"]),
        ("A", {"A": FORCE, "B": (2, "f", 0.5)}, None, ["A"]),  # B is within the bound: it is not needed
        ("b", {"A": FORCE, "b": COUNT}, None, ["b"]),
        ("a+b", {"a": FORCE, "b": COUNT, "c": (0, "f", 4.0)}, None, ["a", "b"]),
        ("c", {"a": FORCE, "b": COUNT, "c": FORCE, "a+b": COUNT}, None, ["a"]),  # equal effects: the ledger's first
        ("a", {"a": FORCE, "B": FORCE, "C": COUNT}, None, ["B"]),  # equal effects: the one known of the engine
        ("a+b", {"a": (2, "f", 0.4), "b": (2, "f", 0.3), "a+b": FORCE}, None, ["a", "b"]),  # visible only together
        ("a", {"a": FORCE, "a+b": COUNT, "b": (0, "f", 0.5)}, None, ["a"]),
        ("a", {"b": COUNT, "a": FORCE, "c": (0, "f", 4.0)}, None, ["a"]),
        ("A", {"A": FORCE, "b": COUNT, "A+b": (2, "f", -4.0)}, None, ["A"]),
        ("a", {"a": FORCE}, (2, "f", 1.0), ["a"]),  # at the bound of the variant
        ("a", {"a": FORCE}, (2, "f", 1.5), []),
        ("", {"a": (2, "f", 0.5)}, (2, "f", 1.25), []),  # within the bound, although it is closer to LAMMPS
        ("", {"a": (2, "f", NAN)}, (2, "f", NAN), ["a"]),
        ("", {"a": (2, "f", NAN)}, (2, "f", 4.0), []),  # a number where the variant has NaN
        ("", {"a": (2, "f", 4.0)}, (2, "f", NAN), []),  # NaN where the variant has a number
    ],
)
def test_smallest_set_that_reproduces_every_value_explains(
    judge: Any, has: str, effects: Effects, also: Effect | None, explanation: list[str]
) -> None:
    verdict, _ = judge(has, effects, *([also] if also else []))
    assert ids(verdict.entries) == explanation and verdict.first is not None
    records = [comparison.record for comparison in verdict.comparisons]
    assert {name for record in records for name in record.explained_by} == set(explanation)
    red = {record.field for record in records if record.verdict == ("explained" if explanation else "differs")}
    moved = {effects[name][1] for name in has.split("+") if name in effects and abs(effects[name][2]) > 1}
    assert red == (moved or {"f"}) and {record.verdict for record in records if record.field not in red} <= {"exact"}
    assert not explanation or verdict.beyond is None


def test_nothing_is_tried_without_a_difference(judge: Any) -> None:
    verdict, predictor = judge("", {"a": FORCE, "b": COUNT})
    assert [comparison.record.verdict for comparison in verdict.comparisons] == ["exact", "exact"]
    assert (verdict.entries, verdict.first, verdict.unseen) == ([], None, [])
    assert set(predictor.asked) == {("", PROBLEM.steps)}


@pytest.mark.parametrize(
    ("has", "effects", "also", "steps"),
    [
        ("a", {"a": FORCE, "b": COUNT}, [(0, "f", 4.0)], (0,)),  # most sets fail at the first step: no later ones
        ("A+B", {"A": FORCE, "B": COUNT}, [], PROBLEM.steps),  # known findings are tried at all steps at once
    ],
)
def test_steps_predicted_for_a_set(judge: Any, has: str, effects: Effects, also: Any, steps: tuple[int, ...]) -> None:
    _, predictor = judge(has, effects, *also)
    assert {steps for names, steps in predictor.asked if "+" in names} == {steps}


@pytest.mark.parametrize(("off", "parts"), [(0.4, [0.5]), (0.6, [0.5, 1.0]), (1.5, [0.5, 1.0])])
def test_full_bounds_are_computed_only_if_partial_ones_are_exceeded(judge: Any, off: float, parts: list[float]) -> None:
    _, predictor = judge("A", {"A": FORCE}, (2, "f", off))
    tried = [part for steps, part in predictor.widened if steps == PROBLEM.steps]
    assert tried[: len(parts)] == parts and (len(tried) == len(parts) or off > 1)


def test_positions_wrapped_by_lammps_are_reproduced(judge: Any) -> None:
    of = replace(PROBLEM, fields=("x",), box=Box((0.0,) * 3, (40.0,) * 3, (True,) * 3))  # each value along its axis
    assert explained(judge("a", {"a": (2, "x", 4.0)}, (2, "x", -40.0), of=of)) == ["a"]


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
    judge: Any, has: str, effects: Effects, own: Effect, beyond: tuple[list[str], int, str] | None
) -> None:
    verdict, predictor = judge(has, effects, own)
    assert verdict.entries == [] and verdict.first is not None
    assert {comparison.record.verdict for comparison in verdict.comparisons} <= {"exact", "differs"}
    left = verdict.beyond
    assert (left and (left.findings, left.blame.step, left.blame.field)) == beyond
    if left:
        assert (left.blame.atom, left.blame.lammps) == (5, REFERENCE + own[2])
    # The same without a verdict, for an answer read at every step; the newest engine is known to have small letters.
    reason = particle_model.reason(PROBLEM, "a.case", ID, predictor.lammps, KNOWN[0], predictor)
    assert reason == Reason(verdict.first, left)


def test_reason_names_known_findings_that_do_not_help(judge: Any) -> None:
    verdict, predictor = judge("", {"a": COUNT}, (2, "coordination", 4.0))
    found = particle_model.reason(PROBLEM, "a.case", ID, predictor.lammps, NEWEST, predictor)
    assert found == Reason(verdict.first, Beyond(findings=[], blame=verdict.first, known=["a"]))
    right = predictor.fields(PROBLEM, frozenset())
    assert particle_model.reason(PROBLEM, "a.case", ID, right, NEWEST, predictor) is None


@pytest.mark.parametrize("open_at", [0, 2])
@pytest.mark.parametrize(("own", "left"), [((2, "f", 0.0), None), (FORCE, (2, "f")), ((5, "f", 4.0), (5, "f"))])
def test_unbounded_value_is_blamed_if_all_bounded_ones_are_inside(
    judge: Any, open_at: int, own: Effect, left: tuple[int, str] | None
) -> None:
    """A set that leaves only unbounded values outside reaches further than one that leaves a bounded field outside."""
    effects = {"a": (open_at, "coordination", 4.0), "b": (0, "f", 4.0)}
    beyond = judge("a", effects, own, without_bound={"a": {open_at: "coordination"}})[0].beyond
    assert beyond.findings == ["a"] and place(beyond.blame) == (left or (open_at, "coordination"))
    assert beyond.blame.bound == (1.0 if left else INF)


def test_bounded_values_of_the_reference_are_blamed_first(judge: Any) -> None:
    bounds = {"": (INF, 1.0, 1.0)}
    assert judge("", {}, bounds=bounds)[0].first.bound == INF
    first = judge("", {}, (5, "f", 4.0), bounds=bounds)[0].first
    assert (*place(first), first.atom, first.outside) == (5, "f", 5, 1)


def test_blame_has_the_lowest_id_outside_and_both_sides(judge: Any) -> None:
    blame = judge("", {}, (2, "f", 1.0, 2), (2, "f", 4.0, 1), (2, "f", 3.0, 0))[0].first
    assert (blame.atom, blame.lammps, blame.reference, blame.bound) == (5, REFERENCE + 4.0, REFERENCE, 1.0)
    assert (blame.field, blame.stage, blame.outside, blame.of) == ("f", FIELDS["f"].stage, 2, 3)


# --- special variants


def test_variant_is_fitted_to_the_first_snapshot_of_lammps(judge: Any) -> None:
    given = set()

    def fit(problem: Problem, stages: type[ArrayEvaluator], snapshot: Snapshot) -> dict[str, Any]:
        given.add((problem.fields, problem.steps[0], stages.__name__, snapshot["f"][1]))
        return {}

    assert explained(judge("a", {"a": (0, "f", 4.0)}, settings={"a": {"fit": fit}})) == ["a"]
    assert given == {(PROBLEM.fields, 0, "Evaluator", REFERENCE + 4.0)}


@pytest.mark.parametrize("undefined", [True, False])
@pytest.mark.parametrize("settings", [{}, {"fit": lambda *given: None}], ids=["runs away", "does not fit"])
def test_variant_that_predicts_nothing_explains_nothing(judge: Any, settings: dict[str, Any], undefined: bool) -> None:
    none = {name: settings | {"undefined": undefined} for name in ("runaway", "RUNAWAY")}
    verdict, predictor = judge("runaway", {"runaway": FORCE, "b": COUNT}, settings=none)
    assert (verdict.entries, verdict.beyond) == ([], None)
    assert ("", (0,)) not in predictor.asked, "nor the reference in its place"
    assert explained(judge("b", {"runaway": FORCE, "b": COUNT}, settings=none)) == ["b"]
    assert judge("", {"RUNAWAY": FORCE}, COUNT, settings=none)[0].beyond is None, "with it as without it"


ONE, NONE = (1.0,) * 3, (1.0, INF, 1.0)  # no bound for the middle particle, which findings change


@pytest.mark.parametrize(
    ("undefined", "own", "of_variant", "beside", "explanation"),
    [
        (True, ONE, NONE, 0.0, ["a"]),
        (True, ONE, NONE, 1.0, ["a"]),
        (True, ONE, NONE, 1.5, []),  # a bounded value is outside
        (False, ONE, NONE, 0.0, []),
        (True, ONE, (INF,) * 3, 0.0, ["a"]),  # a field with nothing left to compare
        (True, NONE, NONE, 0.0, []),  # the reference itself has no bound
        (True, ONE, ONE, 0.0, []),
    ],
)
def test_variant_may_leave_values_without_a_bound(
    judge: Any, undefined: bool, own: Bounds, of_variant: Bounds, beside: float, explanation: list[str]
) -> None:
    settings, bounds = {"a": {"undefined": undefined}}, {"": own, "a": of_variant}
    verdict, _ = judge("a", {"a": FORCE}, (2, "f", 30.0), (2, "f", beside, 0), settings=settings, bounds=bounds)
    assert ids(verdict.entries) == explanation
    text = "not predictable in steps 0 to 5, because of the known bug a"
    assert verdict.unpredictable == (dict.fromkeys(PROBLEM.fields[::-1], text) if of_variant == (INF,) * 3 else {})


@pytest.mark.parametrize(
    ("of_variant", "off", "blamed"),
    [
        ((INF, 1.0, 1.0), 1.5, (3, 1.0, 1)),
        ((INF, 1.0, 1.0), 1.0, (8, INF, 1)),  # a value at its bound is inside
        (ONE, 1.5, (3, 1.0, 1)),
    ],
)
def test_bounded_value_is_blamed_before_an_unbounded_one(
    judge: Any, of_variant: Bounds, off: float, blamed: tuple[int, float, int]
) -> None:
    settings, of = {"A": {"undefined": off > 1}}, replace(PROBLEM, fields=("f",))
    effects = {"A": (0, "f", 4.0)}
    blame = judge("A", effects, (2, "f", off, 2), settings=settings, bounds={"A": of_variant}, of=of)[0].beyond.blame
    assert (blame.atom, blame.bound, blame.outside) == blamed


@pytest.mark.parametrize(("lists", "explanation"), [(True, ["A"]), (False, [])])
@pytest.mark.parametrize("of", [PROBLEM, replace(PROBLEM, steps=(2,))])
def test_findings_that_depend_on_neighbour_lists_need_them(
    judge: Any, of: Problem, lists: bool, explanation: list[str]
) -> None:
    given = {"settings": {"A": {"lists": True}, "a": {"lists": True}}, "lists": lists, "of": of}
    assert explained(judge("A", {"A": FORCE}, **given)) == explanation
    assert explained(judge("a", {"a": FORCE}, **given)) == (["a"] if lists else [])
    assert ids(judge("", {"A": FORCE}, **given)[0].unseen) == explanation
    assert explained(judge("A", {"b": FORCE, "A": FORCE}, **given)) == (explanation or ["b"]), "a known one is first"


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
    verdict, _ = judge(has, effects | {"E": (5, "f", 1.5)}, *also, settings={"D": {"fit": lambda *given: None}})
    assert ids(verdict.unseen) == names


def test_known_finding_that_another_builds_on_is_not_absent(judge: Any) -> None:
    verdict, _ = judge("B+c", {"B": FORCE, "c": COUNT, "D": FORCE}, settings={"c": {"on": "B"}})
    assert (ids(verdict.entries), ids(verdict.unseen)) == (["c"], ["D"])


def test_digits_lost_are_those_of_the_first_evaluation(judge: Any) -> None:
    """Those of LAMMPS are reported only if it evaluates the same formula; a later run has neither them nor a lint."""

    def lost(moved: float) -> dict[str, DigitsLost]:
        return {c.record.field: c.record.digits_lost for c in judge("", {}, (0, "f", moved))[0].comparisons}

    assert lost(0.5)["f"] == DigitsLost(lammps=round(np.log10(0.05 / EPS), 2), reference=0.0)
    assert lost(4.0) == {"f": DigitsLost(reference=0.0), "coordination": DigitsLost(lammps=0.0, reference=0.0)}
    later, _ = judge("", {}, of=replace(PROBLEM, steps=(2, 5)))
    assert {comparison.record.digits_lost.reference for comparison in later.comparisons} == {None}
    assert (judge("", {})[0].lint, later.lint) == (["a mistake"], [])


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
