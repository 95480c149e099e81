"""Runs kept over time: whatever happens to the file, stored runs are read back; views, pages and command."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import multiprocessing
import os
import random
import re
import shutil
import signal
import sqlite3
import subprocess
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.synchronize import Barrier
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from syrupy.assertion import SnapshotAssertion

from eos_ref.errors import InputError
from lammps_cases.records.case_parts import FieldRecord
from lammps_cases.records.files import write_atomically
from lammps_cases.records.outcome import CaseOutcome
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.report import history as kept
from lammps_cases.report.formats import write_report
from lammps_cases.report.history import TABLE, Past, page, runs_before, store, views
from lammps_cases.report.history.store import History
from lammps_cases.report.history.views import RunMark, Spread, engines, natural
from lammps_cases.report.pages import frame
from tests.conftest import ROOT
from tests.support.made_runs import case, run
from tests.support.outcome import Outcome
from tests.support.pages import Page, text_of, unpacked
from tests.support.roundings import rounded


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "deep" / "history.sqlite"


def filled(file: Path, *records: RunRecord) -> History:
    with History(file) as history:
        for record in records:
            history.add(record)
    return history


# --- the file

DAYS = [f"2026-11-{day:02}T08:00:00Z" for day in range(1, 6)]
NUMBERS = st.none() | st.floats() | st.sampled_from([math.nan, math.inf, -math.inf, 0.0, 5e-324, 1.8e308])


@st.composite
def a_case(draw: st.DrawFn, name: str) -> CaseRecord:
    verdict = draw(st.sampled_from(["pass", "explained", "differs", "refused"]))
    finding, expects = "heat" if verdict == "explained" else None, draw(st.sampled_from(["", "bad"]))
    made = case(name, verdict, draw(NUMBERS), draw(st.sampled_from(["aa", "bb", ""])), 0.1, finding)
    made.fields += case(name, "differs", draw(NUMBERS), field="v").fields
    made.fields[0].max_abs = draw(NUMBERS)
    return made.model_copy(update={"message": draw(st.sampled_from(["", "a word"])), "expects": expects})


@st.composite
def some_runs(draw: st.DrawFn) -> list[RunRecord]:
    """Runs of different days, on three engines, of some of three cases."""
    days = draw(st.lists(st.sampled_from(DAYS), min_size=1, max_size=4, unique=True))
    names = st.lists(st.sampled_from(["a.1", "a.2", "b"]), unique=True)
    return [
        run(draw(st.sampled_from(["9.0", "10.0", "1.0rc1"])), day, [draw(a_case(n)) for n in draw(names)])
        for day in days
    ]


def _everything(history: History) -> str:
    """All views of a history, without the ids of its tables, which follow the order of arrival."""
    with history:
        runs = history.runs()
        seen = [views.engines(runs), views.run_lines(history, runs, runs), history.slowest()]
        seen += [
            views.case_views(history, runs, history.cases()),
            views.chosen_runs(runs, last=2),
        ]
    return re.sub(r"\bid=\d+", "", repr(seen))


@settings(max_examples=20, deadline=None)
@given(some_runs(), st.randoms())
def test_runs_added_in_any_order_are_read_back_and_give_the_same_views(
    runs: list[RunRecord], chance: random.Random
) -> None:
    with TemporaryDirectory() as name:
        folder = Path(name)
        history, mixed = filled(folder / "a", *runs), runs * 2
        chance.shuffle(mixed)  # each is kept once
        assert _everything(history) == _everything(filled(folder / "b", *mixed))
        last = max(runs, key=lambda one: one.date)
        earlier = filled(folder / "c", *(one for one in runs if one is not last))
        with history, earlier:
            stored = {one.date: one for one in history.runs()}
            assert repr(runs_before(history, last)).count("label") == repr(runs_before(earlier, last)).count("label")
            for record in runs:
                assert stored[record.date].counts == dict(Counter(CaseOutcome.of(one).kind for one in record.cases))
                results = history.results([stored[record.date].id])
                outcomes = history.outcomes(result.outcome for result in results)
                for made in record.cases:
                    (found,) = (each for each in outcomes.values() if each.case == made.case)
                    meant = CaseOutcome.of(made)
                    fields = {name: replace(field, stage="") for name, field in meant.fields.items()}
                    kept_of_it = replace(meant, fields=fields, seconds=0.0, expects="")
                    assert repr(replace(found, id=0)) == repr(kept_of_it), "all but what runs do not share"


def test_stored_run_is_read_back(file: Path) -> None:
    record = run()
    with History(file) as history:
        assert history.add(record, revision="abc") and not history.add(run())
        assert history.add(run(seconds=3.0)), "another run of the same day"
    with History(file) as history:
        (first, _), content = history.runs(), file.read_bytes()
        results = history.results([first.id])
    assert (first.date, first.revision, first.counts, first.cases) == (record.date, "abc", {"pass": 2}, 2)
    assert first.engine.key == record.engine.library_sha256
    assert [(r.case, r.lammps, r.reference) for r in results] == [("one", 0.1, 0.5), ("two.a", 0.1, 0.5)]
    assert file.read_bytes() == content and [path.name for path in file.parent.iterdir()] == [file.name], "only read"


def test_equal_outcomes_are_stored_once_and_forgotten_with_their_last_run(file: Path) -> None:
    many = [case(f"case-{k}") for k in range(400)]
    with History(file) as history:
        history.add(run(cases=many, date="2026-10-01"))
        first = file.stat().st_size
        history.add(run(cases=many, date="2026-10-02"))
        # an id of a run and of an outcome, two seconds, one entry of an index
        assert file.stat().st_size - first < 400 * 60
        assert len({r.outcome for r in history.results([1, 2])}) == 400
        history.add(run(date="2026-11-01"))
        before = file.stat().st_size
        assert history.forget("2026-11-01") == 2
        assert [one.date for one in history.runs()] == ["2026-11-01"]
        assert history.cases() == ["one", "two.a"]
    with contextlib.closing(sqlite3.connect(file)) as database:
        assert database.execute("SELECT count(*) FROM fields").fetchall() == [(2,)]
    assert file.stat().st_size < before / 2


def test_not_a_number_is_the_worst_field(file: Path) -> None:
    fields = [*case("one", "differs", 9e9).fields, *case("one", "differs", math.nan, field="v").fields]
    with filled(file, run(cases=[CaseRecord(case="one", verdict="differs", fields=fields)])) as history:
        assert history.outcomes([1])[1].worst_field == "v"


def _add_some(file: Path, first: int, together: Barrier) -> None:
    together.wait()
    for k in range(first, first + 3):
        filled(file, run(seconds=float(k)))


@pytest.mark.parametrize("again", range(2))
def test_concurrent_processes_wait_for_each_other(file: Path, again: int) -> None:
    context = multiprocessing.get_context("fork")
    together = context.Barrier(4)
    writers = [context.Process(target=_add_some, args=(file, first, together)) for first in (0, 10, 20, 30)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join(60)
        assert writer.exitcode == 0
    with History(file) as history:
        assert sorted(one.seconds for one in history.runs()) == [10.0 * i + k for i in range(4) for k in range(3)]
        assert all(len(history.results([one.id])) == 2 for one in history.runs())


class Deadly:
    lammps = property(lambda self: os.kill(os.getpid(), signal.SIGKILL))


@pytest.mark.slow
@pytest.mark.parametrize("first", [True, False], ids=["first run", "later run"])
def test_kill_while_a_run_is_added_leaves_the_runs_before_it(file: Path, first: bool) -> None:
    if not first:
        filled(file, run())
    cases = [case(f"case-{k}") for k in range(1500)]
    for one in cases:
        one.message = f"{one.case:2000}"  # more than SQLite keeps in memory: much is on the disk before the end
    record = run(cases=cases, seconds=7.0)
    cases[-1].seconds = Deadly()
    child = os.fork()
    if child == 0:
        with History(file) as history:
            history.add(record, content="x")
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert file.with_name(f"{file.name}-journal").stat().st_size > 0  # killed in the middle
    with History(file) as history:
        assert [one.seconds for one in history.runs()] == [] if first else [2.0]
        assert history.cases() == [] if first else ["one", "two.a"]
        assert history.add(run(seconds=8.0))
        assert history.runs()[-1].seconds == 8.0


def _sql(statement: str) -> Callable[[Path], object]:
    def change(file: Path) -> None:
        with contextlib.closing(sqlite3.connect(file)) as connection:
            connection.execute(statement)
            connection.commit()

    return change


def _damaged_page(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[-4096 : -4096 + 64] = b"\xff" * 64
    file.write_bytes(content)


def _foreign(file: Path) -> None:
    file.unlink()
    _sql("CREATE TABLE bookmarks (address)")(file)


NOTES = "my notes\n" * 1000
DAMAGE: dict[str, Callable[[Path], object]] = {
    "file is not a database": lambda file: file.write_text(NOTES),
    "cannot be used: database disk image is malformed": lambda file: file.write_bytes(file.read_bytes()[:6000]),
    f"must be of schema {store.VERSION} or older": _sql(f"PRAGMA user_version = {store.VERSION + 1}"),
    "is the database of another program": _foreign,
}


@pytest.mark.parametrize("said", DAMAGE)
def test_unusable_file_is_refused_in_one_line_and_left(said: str, file: Path) -> None:
    filled(file, run())
    DAMAGE[said](file)
    content = file.read_bytes()
    told = set()
    for use in (lambda h: h.add(run(seconds=99.0)), lambda h: h.runs(), lambda h: h.forget("2030")):
        with pytest.raises(InputError) as refused, History(file) as history:
            use(history)
        told.add(str(refused.value))
    (line,) = told
    assert file.read_bytes() == content and said in line and str(file) in line


def test_nothing_is_added_to_a_file_with_a_damaged_page(file: Path) -> None:
    filled(file, run(cases=[case(f"case-{k}", digest=f"{k:016x}") for k in range(500)]))
    _damaged_page(file)
    content = file.read_bytes()
    with pytest.raises(InputError, match="cannot be used"), History(file) as history:
        history.add(run(cases=[]))
    assert file.read_bytes() == content


@pytest.mark.parametrize("made", [False, True])
def test_empty_file_and_none_are_empty_histories(file: Path, made: bool) -> None:
    if made:
        file.parent.mkdir()
        file.touch()
    with History(file) as history:
        assert history.runs() == history.cases() == history.results([1]) == []
        assert history.forget("2030") == 0
    assert file.exists() is made
    with History(file) as history:
        assert history.add(run())


# --- runs are collected


def _collected(record: RunRecord, capfd: pytest.CaptureFixture[str]) -> list[str]:
    capfd.readouterr()
    kept.collect(record)
    out, err = capfd.readouterr()
    assert out == ""
    return err.splitlines()


def test_run_is_collected_in_the_file_of_the_variable_with_the_revision_of_the_sources(
    file: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(store.VARIABLE, str(file))
    assert kept.past(run()) is None and _collected(run(), capfd) == []
    assert kept.past(run()) is None, "only the run itself"
    write_atomically(file.with_name("run.json"), run().to_json())
    kept.collect(run(), file.parent)  # the same, by its file
    with History(file) as history:
        (stored,) = history.runs()
    if (ROOT / ".git").exists() and shutil.which("git"):
        head = subprocess.run(["git", "-C", str(ROOT), "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
        assert head.stdout.startswith(stored.revision.removesuffix("-dirty"))
        assert len(stored.revision) >= 12
    else:
        assert stored.revision == ""


@pytest.mark.parametrize("place", ["/proc/nowhere/history.sqlite", "notes/history.sqlite", "notes", "off"])
def test_unusable_history_costs_a_line_and_no_run(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("notes").write_text(NOTES)
    monkeypatch.setenv(store.VARIABLE, place)
    if place == "off":
        monkeypatch.setattr(store, "History", None)
    lines = _collected(run(), capfd)
    assert len(lines) == (place != "off")
    assert all(line.startswith("eos-ref: this run is not in the history: history: cannot be used") for line in lines)
    assert kept.past(run()) is None and Path("notes").read_text() == NOTES


# --- views


def test_versions_sort_numerically_and_other_labels_before_them() -> None:
    rising = ["patch-9", "patch-10", "stable-2", "22Jul2025", "29Aug2024", "0.1", "1!0.1"]
    falling = rising[::-1]
    assert sorted(falling, key=natural) == rising
    rising = ["2024.8.29", "2025.7.22.1.0", "2025.7.22.2.0.dev1", "2025.7.22.2.0rc1", "2025.7.22.2.0"]
    rising += ["2025.7.22.2.0.post1", "2025.7.22.2.1", "2025.7.22.10.0", "2025.12.1"]
    assert all(natural(one) < natural(other) for one, other in itertools.combinations(rising, 2))


@pytest.mark.parametrize(
    ("records", "labels"),
    [
        (
            [
                run("", "2026-11-05", name="path:/b/alpha", sha256="b" * 64),
                run("2025.7.22.10.0", "2026-11-01"),
                run("", "2026-11-04", name="path:/b/omega", sha256="c" * 64),
                run("2025.7.22.2.0", "2026-11-03"),
            ],
            ["2025.7.22.2.0", "2025.7.22.10.0", "omega cccccccc", "alpha bbbbbbbb"],  # builds by date
        ),
        (
            [
                run("1.0", name="env", sha256="a" * 64),
                run("1.0", name="path:/venv", sha256="a" * 64, seconds=3.0),
                run("1.0", sha256="b" * 64),
            ],
            ["1.0 aaaaaaaa", "1.0 bbbbbbbb"],  # identified by their libraries
        ),
    ],
)
def test_engines_are_sorted_and_named(records: list[RunRecord], labels: list[str], file: Path) -> None:
    with filled(file, *records) as history:
        assert [line.label for line in engines(history.runs())] == labels


OLD, NEW, LATE = "2025.7.22.9.0", "2025.7.22.10.0", "2025.7.22.11.0"


@pytest.fixture
def story(tmp_path: Path) -> History:
    """Three engines, added out of order: `bits` changes in each, and back in a part of a run, `verdict` in LATE.

    Another eos-ref judged the last two; of the last run a case has another name.
    """
    history = History(tmp_path / "story.sqlite")
    with history:
        for day, version in enumerate((LATE, OLD, NEW, NEW, NEW, NEW), 1):
            cases = [case("bits", digest={1: "dd", 2: "aa", 5: "aa"}.get(day, "bb"), seconds=0.1 + 0.1 * day)]
            cases += [] if day == 5 else [case("renamed" if day == 6 else "same")]
            if day < 5:
                ends = ("explained", 1e9, "cc", 0.1, "heat") if version == LATE else ()
                cases.append(case("verdict", *ends))
            history.add(run(version, f"2026-11-0{day}", cases), revision="abc" if day < 5 else "def")
    return history


def seen(history: History, *cases: str, field: str = "") -> list[views.CaseView]:
    with history:
        return views.case_views(history, history.runs(), cases or history.cases(), field)


def lines_of(history: History, engine: str = "", last: int | None = None) -> list[views.RunLine]:
    with history:
        every = history.runs()
        return views.run_lines(history, views.chosen_runs(every, engine, last=last), every)


def test_runs_and_cases_are_compared_with_those_before(story: History, snapshot: SnapshotAssertion) -> None:
    """A run with that before it and with the engine before, or all of its runs if none is older; a case by engine.

    Equal outcomes in a row are one span, with the median time.
    """

    def told(of: views.RunDifference | None) -> str:
        return f"{of.label}: {of.sentence}{', judged otherwise' * of.other_judge}" if of else "-"

    said: dict[str, Any] = {
        f"run {line.run.date} {line.label}": (told(line.same), told(line.before)) for line in lines_of(story)
    }
    for view in seen(story):
        spans = [
            f"{s.label} {s.days}: {s.outcome.kind} {s.lammps.count} run(s), {s.lammps.median:.3g} s" for s in view.spans
        ]
        changes = [
            f"{c.before} to {c.engine}: {c.kind} of {c.field or 'case'} {c.was!r} to {c.now!r}"
            + " (first)" * c.first
            + " (judged otherwise)" * c.other_judge
            for c in view.changes
        ]
        said[f"case {view.case}"] = spans, changes
    assert said == snapshot
    assert lines_of(story, engine=NEW, last=1) == lines_of(story)[-1:], "whatever else is selected"
    new = seen(story, "bits")[0].times[NEW]
    assert (new.low, new.count, new.median, new.high) == (0.4, 4, rounded(0.55, 3), rounded(0.7, 3))


def test_single_field_cases_and_runs_are_selected(file: Path, story: History) -> None:
    one = case("one", "differs", 1e9)
    one.fields.append(FieldRecord(field="rho", stage="eos", verdict="exact", max_over_bound=0.0, digest="00"))
    history = filled(file, run(cases=[one]))
    ended = seen(history, field="rho")[0].spans[0].outcome
    assert (ended.kind, ended.worst, ended.worst_field, len(ended.fields)) == ("exact", 0.0, "", 1)
    for field, said in (("speed", "field: none of these cases has it, found 'speed'"), ("rhoo", "did you mean 'rho'")):
        with pytest.raises(InputError, match=said):
            seen(history, field=field)
    assert views.chosen_cases(["one", "two.a"], ["two"]) == ["two.a"]
    with pytest.raises(InputError, match=r"no such case in any stored run: 'force' \(did you mean 'forces'\?\)"):
        views.chosen_cases(["forces.a", "walls.b"], ["walls.*", "force"])
    with story:
        runs = story.runs()
    for chosen, days in (
        ({}, "123456"),
        ({"engine": "pypi:*.10.0"}, "3456"),
        ({"engine": "9.0"}, "2"),
        ({"since": "2026-11-05"}, "56"),
        ({"last": 1}, "6"),
        ({"engine": "9.0", "last": 1}, "2"),
    ):
        assert "".join(one.date[-1] for one in views.chosen_runs(runs, **chosen)) == days, chosen
    rule = r"engine: must be one of which a run is kept \(.*9.0.*found 'nosuch' \(--engine\)"
    with pytest.raises(InputError, match=rule):
        views.chosen_runs(runs, engine="nosuch")
    assert views.chosen_runs([], engine="nosuch") == []


@pytest.mark.parametrize(
    ("values", "logarithmic", "line"),
    [
        ([], False, ""),
        ([1.0], False, "▁"),
        ([1.0, 2.0, 3.0], False, "▁▅█"),
        ([None, math.nan, math.inf, 2.0], False, "·××▁"),
        ([2.0, 2.0], False, "▁▁"),
        ([0.0, 1e-4, 1.0, 1e3, 1e4, 1e11], True, "▁▁▃▄▅█"),
    ],
)
def test_line_of_bars(values: list[float | None], logarithmic: bool, line: str) -> None:
    assert views.spark(values, logarithmic) == line


def test_mark_of_an_outcome() -> None:
    found = [CaseOutcome("one", "differs", False, worst=3.0, worst_field="f"), CaseOutcome("one", "pass", True)]
    marks = [views.mark("1.0", "2026-01-02", "2 runs", outcome) for outcome in found]
    assert marks[0] == RunMark("1.0", "2026-01-02", "differs", 3.0, "1.0, 2 runs: differs, worst in f")
    assert marks[1].says == "1.0, 2 runs: pass"


# --- pages

HOSTILE = "<img src=x onerror=alert(1)> & \"'"
SVG = "{http://www.w3.org/2000/svg}"
HALF_UNIT = 0.5e-6  # of the last digit of a height


def _marks(svg: str) -> list[tuple[str, float]]:
    """Class and height of every mark."""
    groups = [part for part in ET.fromstring(svg).iter(f"{SVG}g") if part.get("class")]
    return [(group.attrib["class"], float(next(group.iter(f"{SVG}use")).attrib["y"])) for group in groups]


def _path(svg: str, name: str) -> list[float]:
    """Heights of the ends of a line."""
    [group] = [part for part in ET.fromstring(svg).iter(f"{SVG}g") if part.get("id", "").endswith(name)]
    return [float(y) for _, y in re.findall(r"[ML] ([\d.]+) ([\d.]+)", next(group.iter(f"{SVG}path")).attrib["d"])]


def test_errors_are_drawn_by_decade_with_the_bound_as_a_line() -> None:
    ratios = [
        ("exact", 0.0),
        ("pass", 0.1),
        ("pass", 1.0),
        ("explained", 1e9),
        ("differs", math.inf),
        ("error", math.nan),
    ]
    svg = page.error_figure([RunMark("1.0", "", kind, ratio, "says") for kind, ratio in ratios], "one")
    found = _marks(svg)
    assert [kind for kind, _ in found] == [f"v-{kind}" for kind, _ in ratios]
    exact, inside, at, beyond, infinite, nan = (y for _, y in found)
    assert exact > inside > at > beyond > infinite == nan
    assert _path(svg, "limit") == [at, at]
    assert 9 * (inside - at) == pytest.approx(at - beyond, rel=0, abs=(9 * 2 + 2) * HALF_UNIT)


def test_times_show_median_and_range() -> None:
    svg = page.time_figure({"1.0": Spread(2.0, 1.0, 4.0, 3), "2.0": Spread(4.0, 4.0, 4.0, 1)}, "one")
    (_, median), (_, other) = _marks(svg)
    low, high = _path(svg, "range-0")
    assert low > median > high == other
    assert 2 * (low - median) == pytest.approx(median - high, rel=0, abs=(2 * 2 + 2) * HALF_UNIT)
    assert "2 s, 1 to 4 s in 3 runs" in svg


def test_text_in_figures_is_never_markup() -> None:
    for svg in (
        page.error_figure([RunMark(HOSTILE, HOSTILE, "pass", 1.0, HOSTILE)], "one"),
        page.time_figure({HOSTILE: Spread(1.0, 1.0, 1.0, 1)}, "one"),
    ):
        assert "<img" not in svg
        assert HOSTILE in "".join(ET.fromstring(svg).itertext())


@pytest.fixture
def history(tmp_path: Path) -> History:
    return filled(
        tmp_path / "h.sqlite",
        run("1.0", "2026-11-01", [case("one"), case("two", digest="b")]),
        run("2.0", "2026-11-02", [case("one"), case("two", "explained", 1e9, "c", finding="heat")]),
        run("2.0", "2026-11-03", [case("one"), case("two", "differs", math.nan, "d")]),
    )


def _page(history: History, folder: Path, pictured: bool = False) -> str:
    with history:
        runs = history.runs()
        lines = views.run_lines(history, runs, runs)
        found = views.case_views(history, runs, history.cases())
    return page.write(folder, lines, found, [line.label for line in engines(runs)], pictured).read_text()


@pytest.mark.parametrize("pictured", [True, False])
def test_page_is_well_formed_and_reproducible(history: History, tmp_path: Path, pictured: bool) -> None:
    html = _page(history, tmp_path / "out", pictured)
    parsed = Page(html)
    ids, tags = parsed.all("id"), [tag for tag, _ in parsed.elements]
    assert parsed.open == [] and len(set(ids)) == len(ids)
    styled = re.findall(r"#([a-z-]+)[ ,{]", (frame.SHARED / "page.css").read_text())
    assert set(ids) & set(styled) == set(), "the look of another page's part"
    assert {a["href"] for tag, a in parsed.elements if tag == "a" and "href" in a} <= {f"#{name}" for name in ids}
    assert tags.count("svg") == (4 if pictured else 0) and "script" not in tags
    assert "http" not in re.sub(r'http-equiv|xmlns(:xlink)?="[^"]*"', "", html)
    assert html == _page(history, tmp_path / "again", pictured)


def test_page_lists_changes(history: History, tmp_path: Path, snapshot: SnapshotAssertion) -> None:
    alike = filled(tmp_path / "alike.sqlite", *(run("1.0", f"2026-11-0{day}", [case("one")]) for day in (1, 2)))
    assert {name: text_of(_page(of, tmp_path)) for name, of in (("changes", history), ("none", alike))} == snapshot


def _past(history: History, record: RunRecord) -> Past:
    with history:
        found = runs_before(history, record)
    assert found is not None
    return found


def test_report_knows_the_runs_before_it(history: History) -> None:
    past = _past(history, run("1.5", "2026-11-04", [case("two", "pass", 0.5)]))
    told = [(line.label, line.own) for line in past.runs]
    assert told == [("1.5", True), ("2.0", False), ("2.0", False), ("1.0", False)]
    assert {name: [(m.label, m.under, m.kind) for m in marks] for name, marks in past.marks.items()} == {
        "two": [
            ("1.0", "2026-11-01", "pass"),
            ("1.5", "this run", "pass"),
            ("2.0", "2026-11-02", "explained"),
            ("2.0", "2026-11-03", "differs"),
        ]
    }
    own = run("1.5", "2026-11-02", [case("two")])
    past = _past(history, own)
    assert [line.run.date[-1] for line in past.runs] == ["2", "2", "1"]
    filled(history.path, own, run("3.0", "2026-11-05"))
    assert _past(history, own) == past, "neither itself nor later runs count"
    filled(history.path, *(run("2.0", f"2026-11-{k + 1:02d}T12", seconds=float(k)) for k in range(30)))
    assert len(_past(history, run("2.0", "2026-12-01")).runs) == TABLE


def test_report_with_and_without_history(history: History, tmp_path: Path) -> None:
    own = run("1.5", "2026-11-04", [case("two", "pass", 0.5), case("new")])
    plain = unpacked(write_report(own, tmp_path).read_text())
    assert "#history" not in plain and "By version: " not in plain
    past = _past(history, own)
    html = unpacked(write_report(own, tmp_path, history=past).read_text())
    parsed = Page(html)
    assert parsed.open == [] and "history" in parsed.all("id") and "#history" in parsed.all("href")
    assert html.count("By version: ") == 1  # of the case that earlier runs had too
    assert html == unpacked(write_report(own, tmp_path, history=past).read_text())


# --- the command

Command = Callable[..., Outcome]


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, eos_ref_command: Command) -> Command:
    """Run ``eos-ref history ARGUMENTS`` on a separate history."""
    monkeypatch.setenv(store.VARIABLE, str(tmp_path / "h.sqlite"))
    return lambda *given: eos_ref_command("history", "--out", tmp_path / "out", *given)


@pytest.fixture
def two(tmp_path: Path) -> None:
    first = run("9.0", "2026-11-01T08:00:00Z", [case("walls.a"), case("walls.b", ratio=math.nan)])
    second = [case("walls.a", "differs", math.inf, "b"), case("walls.b")]
    filled(tmp_path / "h.sqlite", first, run("10.0", "2026-11-02T08:00:00Z", second))


def test_empty_history_is_reported(command: Command, tmp_path: Path) -> None:
    ended = command()
    assert ended.code == 0
    assert ended.out.startswith(f"no run is kept yet in {tmp_path / 'h.sqlite'}")
    assert list(tmp_path.iterdir()) == []
    assert json.loads(command("--json").out)["runs"] == []


@pytest.mark.usefixtures("two")
def test_runs_cases_and_changes_are_listed(command: Command, tmp_path: Path, snapshot: SnapshotAssertion) -> None:
    every = ((), ("walls.a",), ("walls",), ("walls", "--verdicts"), ("walls", "--errors"), ("walls", "--times"))
    outs = {" ".join(("history", *given)): command(*given).out.replace(str(tmp_path), "TMP") for given in every}
    assert {name: [line.strip() for line in out.splitlines()] for name, out in outs.items()} == snapshot
    assert (tmp_path / "out" / "history.html").exists()


@pytest.mark.usefixtures("two")
def test_json_is_one_document(command: Command) -> None:
    def strict(text: str) -> Any:
        return json.loads(text, parse_constant=lambda name: pytest.fail(name))

    ended = command("walls", "--json")
    assert ended.err == ""
    document = strict(ended.out)
    assert [one["label"] for one in document["runs"]] == ["9.0", "10.0"]
    assert [one["case"] for one in document["cases"]] == ["walls.a", "walls.b"]
    assert document["cases"][0]["spans"][1]["outcome"]["worst"] == "Infinity"
    assert document["cases"][1]["spans"][0]["outcome"]["worst"] == "NaN"
    assert document["cases"][0]["changes"][0]["engine"] == "10.0"
    assert "cases" not in strict(command("--json").out)
    assert ended.out == command("walls", "--json").out


def test_earlier_reports_are_added_once(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record = run()
    write_atomically(tmp_path / "run" / "run.json", record.to_json())
    for place in (tmp_path / "run", tmp_path / "run" / "run.json"):
        assert len(json.loads(command("--add", place, "--json").out)["runs"]) == 1
    with History(tmp_path / "h.sqlite") as history:
        assert not history.add(record)  # as eos-ref run would
    monkeypatch.setenv(store.VARIABLE, "off")
    assert command().err == "eos-ref: history: is switched off: EOS_REF_HISTORY is off; name a file with --db\n"
    ended = command("--db", tmp_path / "other.sqlite", "--add", tmp_path / "run", "--json")
    assert len(json.loads(ended.out)["runs"]) == 1
    write_atomically(tmp_path / "run" / "run.json", "{}")
    ended = command("--db", tmp_path / "other.sqlite", "--add", tmp_path / "run")
    assert ended.code == 2
    assert len(ended.err.splitlines()) == 1


@pytest.mark.usefixtures("two")
def test_runs_before_a_day_are_deleted(command: Command) -> None:
    assert command("--forget", "2026-11-02").out == "1 run before 2026-11-02 forgotten, 1 left\n"
    assert len(json.loads(command("--json").out)["runs"]) == 1


@pytest.mark.usefixtures("two")
@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("wall",), "no such case in any stored run: 'wall' (did you mean 'walls'?)"),
        (("walls", "--field", "speed"), "field: none of these cases has it, found 'speed'"),
        (("--since", "yesterday"), "date: must be a day such as 2026-01-31, found 'yesterday' (--since)"),
        (("--forget", "2026-02-30"), "date: must be a day such as 2026-01-31, found '2026-02-30' (--forget)"),
        (("--db", "/nowhere/h.sqlite"), "history: does not exist (/nowhere/h.sqlite)"),
        (("--db", "/proc"), "history: must be a regular file (/proc)"),
        (
            ("--out", "/proc/nowhere"),
            "output folder: cannot be written: No such file or directory, found '/proc/nowhere'",
        ),
    ],
)
def test_bad_input_is_one_line(command: Command, given: tuple[str, ...], said: str) -> None:
    ended = command(*given)
    assert (ended.code, ended.out, ended.err.splitlines()) == (2, "", [f"eos-ref: {said}"])
