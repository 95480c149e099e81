"""Views of a history: the order of engines, changes, the course of a case."""

from __future__ import annotations

import itertools
import random
from pathlib import Path

import pytest

from eos_ref.errors import InputError
from lammps_cases.records.case_parts import FieldRecord
from lammps_cases.records.run_record import RunRecord
from lammps_cases.report.history import views
from lammps_cases.report.history.store import History, StoredRun
from lammps_cases.report.history.views import engines, natural
from tests.support import made_runs
from tests.support.roundings import rounded


def _labels(*records: RunRecord, tmp_path: Path) -> list[str]:
    with History(tmp_path / "h.sqlite") as history:
        for record in records:
            history.add(record)
        return [line.label for line in engines(history.runs())]


def test_versions_sort_numerically() -> None:
    rising = ["2024.8.29", "2025.7.22.1.0", "2025.7.22.2.0.dev1", "2025.7.22.2.0rc1", "2025.7.22.2.0"]
    rising += ["2025.7.22.2.0.post1", "2025.7.22.2.1", "2025.7.22.10.0", "2025.12.1"]
    shuffled = rising[:]
    random.Random(3).shuffle(shuffled)
    assert sorted(shuffled, key=natural) == rising
    for one, other in itertools.pairwise(rising):
        assert natural(one) < natural(other)


def test_other_labels_sort_numerically_before_all_versions() -> None:
    rising = ["patch-9", "patch-10", "stable-2", "22Jul2025", "29Aug2024", "0.1", "1!0.1"]
    falling = rising[::-1]
    assert sorted(falling, key=natural) == rising


def test_releases_are_sorted_by_version_and_builds_by_date(tmp_path: Path) -> None:
    made = made_runs.run
    records = [
        made("", "2026-11-05", name="path:/b/alpha", sha256="b" * 64),
        made("2025.7.22.10.0", "2026-11-01"),
        made("", "2026-11-04", name="path:/b/omega", sha256="c" * 64),
        made("2025.7.22.2.0", "2026-11-03"),
    ]
    expected = ["2025.7.22.2.0", "2025.7.22.10.0", "omega cccccccc", "alpha bbbbbbbb"]
    assert _labels(*records, tmp_path=tmp_path) == expected


def test_engines_are_identified_by_library(tmp_path: Path) -> None:
    records = [
        made_runs.run("1.0", name="env", sha256="a" * 64),
        made_runs.run("1.0", name="path:/venv", sha256="a" * 64, seconds=3.0),
        made_runs.run("1.0", sha256="b" * 64),
    ]
    assert _labels(*records, tmp_path=tmp_path) == ["1.0 aaaaaaaa", "1.0 bbbbbbbb"]


OLD, NEW, LATE = "2025.7.22.9.0", "2025.7.22.10.0", "2025.7.22.11.0"


@pytest.fixture
def history(tmp_path: Path) -> History:
    """Three engines, added out of order: `bits` changes bits in NEW, `verdict` in LATE, `same` never."""
    case = made_runs.case
    with History(tmp_path / "h.sqlite") as history:
        for version, date in ((LATE, "2026-11-01"), (OLD, "2026-11-02"), (NEW, "2026-11-03"), (NEW, "2026-11-04")):
            cases = [
                case("bits", digest="aa" if version == OLD else "bb", seconds=0.1 + 0.1 * int(date[-1])),
                case("same"),
                case("verdict", "explained", 1e9, "cc", finding="heat") if version == LATE else case("verdict"),
            ]
            history.add(made_runs.run(version, date, cases))
    return history


def _views(history: History, *cases: str, field: str = "") -> list[views.CaseView]:
    with history:
        return views.case_views(history, history.runs(), cases or history.cases(), field)


def test_first_engine_that_changed_a_case_is_named(history: History) -> None:
    bits, same, verdict = _views(history)
    assert same.changes == ()
    (change,) = bits.changes
    assert (change.field, change.kind, change.before, change.engine) == ("f", "bits", OLD, NEW)
    assert (change.was, change.now, change.first) == ("aa", "bb", True)
    told = {(c.field, c.kind, c.was, c.now) for c in verdict.changes}
    assert told == {
        ("", "verdict", "pass", "explained"),
        ("f", "verdict", "pass", "explained"),
        ("f", "bits", "00000000000000aa", "cc"),
        ("f", "finding", "", "heat"),
    }
    assert {(c.before, c.engine) for c in verdict.changes} == {(NEW, LATE)}


def test_only_one_change_is_marked_first(tmp_path: Path) -> None:
    with History(tmp_path / "h.sqlite") as history:
        for k in range(3):
            history.add(made_runs.run(f"{k}.0", cases=[made_runs.case("one", digest=str(k))]))
        (view,) = views.case_views(history, history.runs(), ["one"])
    assert [(c.engine, c.first) for c in view.changes] == [("1.0", True), ("2.0", False)]


def test_runs_with_equal_outcomes_are_one_span_with_the_median_time(history: History) -> None:
    (view,) = _views(history, "bits")
    assert [(s.label, s.since, s.until, s.lammps.count) for s in view.spans] == [
        (OLD, "2026-11-02", "2026-11-02", 1),
        (NEW, "2026-11-03", "2026-11-04", 2),
        (LATE, "2026-11-01", "2026-11-01", 1),
    ]
    new = view.times[NEW]
    assert (new.low, new.high) == (0.4, 0.5)
    assert new.median == rounded(0.45, 3)


def test_alternating_outcomes_of_an_engine_are_separate_spans(tmp_path: Path) -> None:
    with History(tmp_path / "h.sqlite") as history:
        for k, digest in enumerate("aba"):
            history.add(made_runs.run(date=f"2026-11-0{k + 1}", cases=[made_runs.case("one", digest=digest)]))
        (view,) = views.case_views(history, history.runs(), ["one"])
    assert [field.digest for span in view.spans for field in span.outcome.fields.values()] == ["a", "b", "a"]


def _lines(history: History, engine: str = "", last: int | None = None) -> list[views.RunLine]:
    with history:
        every = history.runs()
        return views.run_lines(history, views.chosen_runs(every, engine, last=last), every)


def test_run_is_compared_with_the_run_and_the_engine_before(history: History) -> None:
    late, old, new, again = _lines(history)
    assert old.before is None
    assert old.same is None
    assert new.before is not None
    assert (new.before.label, new.before.changed) == (OLD, {"verdict": 0, "bits": 1, "finding": 0})
    assert again.same is not None
    assert again.same.sentence == "same"
    assert late.before is not None  # no run of the version before it is older
    assert (late.before.label, late.before.sentence) == (NEW, "other verdict in 1, other bits in 1, other finding in 1")


def test_selection_does_not_change_what_a_run_is_compared_with(history: History) -> None:
    (line,) = _lines(history, engine=NEW, last=1)
    assert line == _lines(history)[-1]


def test_parts_of_a_run_add_up_and_a_renamed_case_is_new(tmp_path: Path) -> None:
    case = made_runs.case
    with History(tmp_path / "h.sqlite") as history:
        history.add(made_runs.run(date="2026-11-01", cases=[case("a")]))
        history.add(made_runs.run(date="2026-11-02", cases=[case("b")]))
        history.add(made_runs.run(date="2026-11-03", cases=[case("a", digest="other"), case("b"), case("renamed")]))
        *_, last = views.run_lines(history, history.runs(), history.runs())
        old, new = views.case_views(history, history.runs(), ["b", "renamed"])
    assert last.same is not None
    assert (last.same.common, last.same.new, last.same.gone, last.same.changed["bits"]) == (2, 1, 0, 1)
    assert last.same.sentence == "other bits in 1 (1 new)"
    assert (len(old.spans), len(new.spans)) == (1, 1)
    assert new.spans[0].since == "2026-11-03"


def test_missing_case_is_reported(tmp_path: Path) -> None:
    with History(tmp_path / "h.sqlite") as history:
        history.add(made_runs.run(date="2026-11-01"))
        history.add(made_runs.run(date="2026-11-02", cases=[made_runs.case("one")]))
        *_, last = views.run_lines(history, history.runs(), history.runs())
        assert views.chosen_cases(history.cases(), ["two"]) == ["two.a"]
    assert last.same is not None
    assert last.same.sentence == "same (1 not run)"


def test_change_of_eos_ref_is_reported(tmp_path: Path) -> None:
    with History(tmp_path / "h.sqlite") as history:
        history.add(made_runs.run("1.0"), revision="abc")
        history.add(made_runs.run("2.0", cases=[made_runs.case("one", digest="other")]), revision="def")
        (view,) = views.case_views(history, history.runs(), ["one"])
        *_, last = views.run_lines(history, history.runs(), history.runs())
    assert view.changes[0].other_judge
    assert last.before is not None
    assert last.before.other_judge


def test_a_single_field_may_be_selected(tmp_path: Path) -> None:
    one = made_runs.case("one", "differs", 1e9)
    one.fields.append(FieldRecord(field="rho", stage="eos", verdict="exact", max_over_bound=0.0, digest="00"))
    with History(tmp_path / "h.sqlite") as history:
        history.add(made_runs.run(cases=[one]))
        (view,) = views.case_views(history, history.runs(), ["one"], "rho")
        ended = view.spans[0].outcome
        assert (ended.kind, ended.worst, ended.worst_field, len(ended.fields)) == ("exact", 0.0, "", 1)
        with pytest.raises(InputError, match="field: none of these cases has it, found 'speed'"):
            views.case_views(history, history.runs(), ["one"], "speed")
        with pytest.raises(InputError, match="did you mean 'rho'"):
            views.case_views(history, history.runs(), ["one"], "rhoo")


def test_runs_are_chosen_by_engine_day_and_number(history: History) -> None:
    with history:
        runs = history.runs()

    def dates(found: list[StoredRun]) -> list[str]:
        return [run.date[-1] for run in found]

    assert dates(views.chosen_runs(runs)) == ["1", "2", "3", "4"]
    assert dates(views.chosen_runs(runs, engine="pypi:*.10.0")) == ["3", "4"]
    assert dates(views.chosen_runs(runs, engine="9.0")) == ["2"]
    assert dates(views.chosen_runs(runs, since="2026-11-03")) == ["3", "4"]
    assert dates(views.chosen_runs(runs, last=1)) == ["4"]
    assert dates(views.chosen_runs(runs, engine="9.0", last=1)) == ["2"]
    with pytest.raises(
        InputError, match=r"engine: must be one of which a run is kept \(.*9.0.*found 'nosuch' \(--engine\)"
    ):
        views.chosen_runs(runs, engine="nosuch")
    assert views.chosen_runs([], engine="nosuch") == []


def test_unknown_case_is_bad_input() -> None:
    with pytest.raises(InputError, match=r"no such case in any stored run: 'force' \(did you mean 'forces'\?\)"):
        views.chosen_cases(["forces.a", "walls.b"], ["walls.*", "force"])
