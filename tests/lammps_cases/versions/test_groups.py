"""Summary of hundreds of changes in a few lines."""

from __future__ import annotations

from lammps_cases.versions.change import Policy, groups
from lammps_cases.versions.changes import compare
from lammps_cases.versions.outcomes import Side
from lammps_cases.versions.timing import TOTAL, Turns, of_saved
from tests.support.made_sides import case, ended, field, side


def _sides() -> tuple[Side, Side]:
    before = [case(f"c{k:03}", field("f"), field("v"), field("x")) for k in range(100)]
    found = {"verdict": "explained", "bits": "bb", "over": 1e9, "findings": ["heavy"]}
    after = [case(f"c{k:03}", *(field(n, **found) for n in "fvx")) for k in range(100)]
    one = case("odd", field("f", verdict="differs", over=2.0, bits="cc"))
    refused = ended("refused", "refused", name="shut")
    return side(*before, case("odd", field("f")), case("shut", field())), side(*after, one, refused)


def test_three_hundred_fields_are_summarised_in_one_line() -> None:
    lines = [group.sentence() for group in groups(compare(*_sides(), Policy()).fields)]
    assert lines == [
        "newly refused: 1 case (shut); A agrees with the reference",
        "changed: heavy in B only: 300 fields of 100 cases (f 100, v 100, x 100); A agrees with the reference",
        "changed: unexplained in B only: f in 1 case; A agrees with the reference",
    ]


def test_sides_are_called_by_their_names() -> None:
    turned = [group.sentence("old", "new") for group in groups(compare(*_sides()[::-1], Policy()).fields)]
    assert (
        "changed: heavy in old only: 300 fields of 100 cases (f 100, v 100, x 100); new agrees with the reference"
        in turned
    )


def test_field_that_exchanged_findings_is_in_both_groups() -> None:
    a = side(case("one", field(verdict="explained", findings=["p", "q"], over=4.0)))
    b = side(case("one", field(verdict="explained", findings=["q", "r"], over=3.0, bits="bb")))
    found = groups(compare(a, b, Policy()).fields)
    assert [(g.trait, g.side, g.count) for g in found] == [("p", "A", 1), ("r", "B", 1)]
    assert found[0].sentence() == "changed: p in A only: f in 1 case; closer to the reference: B 1"


def test_unchanged_fields_form_no_group() -> None:
    assert groups(compare(side(case("one", field())), side(case("one", field())), Policy()).fields) == []


# --- times


def test_single_calls_give_a_ratio_without_an_answer() -> None:
    """A machine that was busy during one run slows all of its cases, which no interval over cases shows."""
    a = side(*(case(f"c{k}", field(), seconds=0.01 * (k + 1)) for k in range(20)))
    b = side(*(case(f"c{k}", field(), seconds=0.02 * (k + 1)) for k in range(20)), ended("refused", "refused"))
    found = of_saved(a, b)
    assert found is not None
    assert (found.count, found.ratio.median, found.answer) == (20, 2.0, "cannot tell")
    assert "single calls" in found.sentence()
    assert of_saved(a, side(ended("refused", "refused"))) is None


def test_alternating_times_are_compared_round_by_round() -> None:
    drift = tuple(1.5**k for k in range(9))
    turns = Turns({(TOTAL, "A"): drift, (TOTAL, "B"): tuple(1.01 * t for t in drift)})
    (slower,), (faster,) = turns.against("A", "B"), turns.against("B", "A")
    assert (slower.answer, faster.answer) == ("slower", "faster")
    assert slower.sentence("old", "new").endswith("(9 rounds in turns): new is slower")


def test_single_scene_is_slower_only_if_every_round_is() -> None:
    """One of several 95 % intervals may exclude 1 by chance; the same ratios of all scenes together are conclusive."""
    once = (0.99, *(1.01 + 0.001 * k for k in range(8)))
    ones = (1.0,) * 9
    times = {(name, side): once if side == "B" else ones for name in (TOTAL, "shift") for side in "AB"}
    together, shift = Turns(times).against("A", "B")
    assert (together.answer, shift.answer) == ("slower", "cannot tell")
    times["shift", "B"] = tuple(1.01 + 0.001 * k for k in range(9))
    assert Turns(times).against("A", "B")[1].answer == "slower"
