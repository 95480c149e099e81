"""Planted faults turn cases red by the ordinary verdict; without one nothing is red; what is not seen is said."""

from __future__ import annotations

import ast
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.engine import installations
from lammps_cases.records.progress import SILENT
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.studies.mutation import (
    catalogue,
    collect,
    edits,
    formula,
    input_faults,
    output_faults,
    page,
    record,
    schedule,
    source,
)
from lammps_cases.studies.mutation.alarms import Alarm, AlarmRun
from lammps_cases.studies.mutation.fault import FAMILIES, KINDS, Detection, Fault, files
from lammps_cases.studies.mutation.record import ControlRecord, FaultRecord, Power
from lammps_cases.studies.mutation.schedule import MutationPool
from lammps_cases.studies.mutation.source import SourceFault
from lammps_cases.studies.mutation.substitute import Mutation, load
from lammps_cases.studies.mutation.tasks import Control
from tests.support.outcome import Outcome

CASES = {case.name: case for case in casefile.load()}
# Small cases without time steps: laws of several types, a gas, viscosities, surfaces, a refusal.
NAMES = ("ranges.background-override", "ideal-gas.beside-tait", "strain.thinning.2d", "power-status.divergence")
REFUSED = "refused.no-fix-rheo"
LAW, GAS, FLUID, SURFACE = NAMES
# fault: the case that sees it first, the verdict, the field it names
SEEN: dict[str, tuple[str, str, str] | None] = {
    "told.cs-off": (LAW, "differs", "pressure_used"),
    "told.range-ends-early": (LAW, "differs", "pressure_used"),
    "told.energy-not-per-mass": (GAS, "differs", "esph"),
    "told.no-pressure-fix": (LAW, "crashed", ""),
    "told.power-gd0": (FLUID, "differs", "viscosity"),
    "told.refusal-not-asked": (REFUSED, "differs", ""),
    "read.single-rho": (LAW, "differs", "rho"),
    "read.one-off-output-grad-v": (FLUID, "differs", "grad/v"),
    "read.one-more-output-status": (SURFACE, "differs", "status"),
    "read.id-repeated": (LAW, "differs", "id"),
    "formula.lint-background-dropped": (LAW, "differs", "pressure_used"),
    "formula.lint-masses-ignored": (FLUID, "differs", "grad/v"),
    "formula.strain-half": (FLUID, "differs", "viscosity"),
    "formula.status-without-layer": (SURFACE, "differs", "status"),
    "formula.kick-missing": None,  # no time step here
    "source.hangs": (LAW, "timeout", ""),
    "source.dies": (LAW, "crashed", ""),
    "source.raises": (LAW, "crashed", ""),
}


def _own_fault(name: str, statement: str) -> SourceFault:
    """A fault in the law of NAMES[0]."""
    changed = edits.edited(edits.text_of("eos.laws"), "linear", "return cs * cs * (rho - rho0)", statement)
    return SourceFault(f"source.{name}", "source", statement, "eos.laws", changed)


OWN = {
    fault.id: fault
    for fault in (
        _own_fault("hangs", "while True: pass"),
        _own_fault("dies", "import os; os._exit(3)"),
        _own_fault("raises", "raise ValueError('no')"),
    )
}


@pytest.fixture(scope="module")
def planted() -> Iterator[tuple[list[Control], dict[str, tuple[Detection, ...]]]]:
    """The control, and all faults of SEEN planted."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(schedule, "CASE_LIMIT", 2.0)
        with MutationPool(installations.resolve("env"), 2, None) as pool:
            control = pool.prepare([CASES[name] for name in (*NAMES, REFUSED)], SILENT)
            faults = catalogue.faults() | OWN
            yield control, {fault.id: found for fault, found in pool.plant([faults[name] for name in SEEN])}


@pytest.mark.lammps
def test_without_a_fault_nothing_is_red(planted: tuple[list[Control], dict[str, tuple[Detection, ...]]]) -> None:
    control, _ = planted
    assert [(c.case, c.answered, c.played, c.red) for c in control] == [
        *((name, True, True, ()) for name in NAMES),
        (REFUSED, True, None, ()),
    ]


@pytest.mark.lammps
@pytest.mark.parametrize("fault", SEEN)
def test_planted_fault_is_seen(fault: str, planted: tuple[list[Control], dict[str, tuple[Detection, ...]]]) -> None:
    seen = planted[1][fault]
    expected = SEEN[fault]
    if expected is None:
        assert seen == ()
    else:
        assert (seen[0].case, seen[0].verdict, seen[0].field) == expected
        assert len(seen) == len(files(seen)) <= schedule.WITNESSES, "no more than it takes to know two scenes"


@pytest.mark.lammps
def test_every_case_that_sees_a_fault() -> None:
    with MutationPool(installations.resolve("env"), 1, None, every=True) as pool:
        pool.prepare([CASES[LAW], CASES[GAS]], SILENT)
        planted = list(pool.plant([catalogue.faults()[name] for name in ("told.cs-off", "formula.linear-of-rho")]))
    assert {fault.id: sorted(one.case for one in detections) for fault, detections in planted} == {
        "told.cs-off": sorted((LAW, GAS)),
        "formula.linear-of-rho": [LAW],
    }


# --- the faults themselves


@pytest.mark.slow
def test_faults_are_many_and_named_once() -> None:
    faults = catalogue.faults()
    assert len(faults) >= 500
    assert {fault.family for fault in faults.values()} == set(FAMILIES)
    assert {fault.kind for fault in faults.values()} == set(KINDS)
    assert all(name == fault.id and fault.what for name, fault in faults.items())


@pytest.mark.slow
def test_mistakes_that_an_engine_has_are_not_planted_there() -> None:
    assert "formula.lint-no-volume-in-the-force" not in catalogue.faults("2025.7.22.4.0")
    assert "formula.lint-no-volume-in-the-force" in catalogue.faults("2025.7.22.1.0")
    assert "formula.lint-heat-divided-by-the-density" in catalogue.faults("2025.7.22.4.0")


@pytest.mark.slow
def test_changed_sources_are_others_each() -> None:
    changed = [fault for fault in catalogue.faults().values() if isinstance(fault, SourceFault)]
    # A named mistake may be one that is made by machine too.
    assert len({(fault.family, fault.module, fault.text) for fault in changed}) == len(changed)
    for fault in formula.faults().values():
        if isinstance(fault, SourceFault):
            compile(fault.text, fault.id, "exec")
    for drawn in source.faults().values():
        before, _, after = drawn.what.partition(": ")[2].partition(" \N{RIGHTWARDS ARROW} ")
        assert before != after, drawn.id


def test_faults_keep_their_names_when_code_is_added() -> None:
    text = edits.text_of("kernels.quintic")
    before = source.names("kernels.quintic", ast.parse(text))
    after = source.names("kernels.quintic", ast.parse(text + "\n\ndef more(a, b):\n    return a + b\n"))
    assert set(after) - set(before) == {"source.kernels.more.operator-1"}
    assert {name: after[name] for name in before} == before


@pytest.mark.slow
def test_a_sample_is_the_same_each_time() -> None:
    drawn = [fault.id for fault in collect.select(catalogue.faults(), (), sample=7)]
    assert drawn == [fault.id for fault in collect.select(catalogue.faults(), (), sample=7)]
    assert len(drawn) == 7


def test_a_fault_that_changes_nothing_does_not_apply() -> None:
    ready = prepared_case.prepare(CASES[FLUID])
    assert input_faults.jobs(catalogue.input_faults()["told.A3-sign"], ready) is None
    assert input_faults.jobs(catalogue.input_faults()["told.mass-off"], ready) is not None


@pytest.mark.lammps
def test_an_answer_is_spoiled_without_touching_the_right_one(planted: Any) -> None:
    from lammps_cases.engine.session import Answer

    right = {"id": np.arange(1, 5), "f": np.arange(12.0).reshape(4, 3)}
    answer = Answer(right, 0.0, (right,), (0,))
    for fault in output_faults.faults().values():
        faulty = output_faults.applied(fault, answer)
        assert right["f"].tolist() == np.arange(12.0).reshape(4, 3).tolist(), fault.id
        assert faulty is None or set(faulty.arrays) == set(right)


def test_a_loaded_reference_cannot_be_mistaken() -> None:
    with pytest.raises(RuntimeError, match="loaded already"):
        load(Mutation("eos.laws", "x = 1"))


@pytest.mark.lammps
def test_arguments_are_of_faults_that_are_planted() -> None:
    planted = {(fault.id, fault.what) for fault in catalogue.faults().values()}
    assert set(record.arguments()) <= planted


@pytest.mark.slow
def test_names_of_faults() -> None:
    faults = catalogue.faults()
    assert [f.id for f in collect.select(faults, ("told.cs-o*",))] == ["told.cs-off", "told.cs-of-one"]
    with pytest.raises(InputError, match=r"did you mean 'told\.cs-off"):
        collect.select(faults, ("told.cs-of",))


# --- the record


def _power(*faults: FaultRecord, **more: Any) -> Power:
    whole = {"whole": False, "quick_only": False, "controls": (), "resolution": (), "alarms": ()} | more
    return Power("eos-ref power", {"cores": "2"}, {"name": "env"}, seconds=1.0, faults=faults, **whole)


def _fault(name: str, *cases: str, quick: bool = True, argued: str = "") -> FaultRecord:
    seen = tuple(Detection(case, "differs", "f", "") for case in cases)
    return FaultRecord(f"told.{name}", "told", "constant", name, cases, quick and bool(cases), seen, argued)


def _alarmed(alarm: Alarm) -> AlarmRun:
    return AlarmRun(alarm.kind, "two", cases=1, same_bits=0, within=0, verdicts={"differs": 1}, alarms=(alarm,))


def test_what_is_wrong_is_said() -> None:
    assert _power(_fault("a", "x")).complaints == []
    assert _power(_fault("a", argued="equal")).complaints == []
    assert "unseen: told.a" in _power(_fault("a")).complaints[0]
    red = ControlRecord("told", 3, ("x: differs",))
    assert "control told: x" in _power(_fault("a", "x"), controls=(red,)).complaints[0]
    alarm = _alarmed(Alarm("x", "ranks", "differs", "f"))
    known = _alarmed(replace(alarm.alarms[0], finding="walls-after-rebuild"))
    assert _power(_fault("a", "x"), alarms=(known,)).complaints == []
    assert "false alarm, ranks: x" in _power(_fault("a", "x"), alarms=(alarm,)).complaints[0]


BUGS = "1 known bug seen in this LAMMPS (severe)"


def _known() -> Power:
    alarm = _alarmed(Alarm("x", "ranks", "differs", "f", finding="walls-after-rebuild"))
    return _power(_fault("a", "x"), alarms=(alarm,))


def test_headline() -> None:
    assert str(_power(_fault("a", "x")).headline("low")) == "PASS: all checks as required"
    assert str(_power(_fault("a")).headline()) == "FAIL: 1 complaint"
    assert str(_known().headline()) == f"KNOWN BUGS: {BUGS}; nothing new"
    assert str(_known().headline("high")) == f"FAIL: {BUGS}; 1 rejected by --fail-on high; nothing new"


@pytest.mark.slow
def test_the_page_begins_with_the_headline(tmp_path: Path) -> None:
    page.write(_known(), tmp_path)
    assert f'<span class="stamp">KNOWN BUGS</span> {BUGS}; nothing new</h1>' in (tmp_path / "power.html").read_text()


@pytest.mark.parametrize(
    ("slow", "unseen", "quick_only", "wrong"),
    [
        (10, 0, False, []),
        (11, 0, False, ["quick"]),
        (0, 1, False, []),
        (0, 2, False, ["all"]),
        (11, 0, True, ["quick"]),
    ],
)
def test_rates_count_for_all_faults_together(slow: int, unseen: int, quick_only: bool, wrong: list[str]) -> None:
    faults = [_fault(str(k), "x", quick=k >= slow) for k in range(100 - unseen)]
    faults += [_fault(f"unseen-{k}", argued="equal") for k in range(unseen)]
    found = _power(*faults, whole=True, quick_only=quick_only).complaints
    assert [line.split()[0] for line in found] == wrong
    assert _power(*faults).complaints == []


def test_a_red_control_is_of_the_families_that_use_it() -> None:
    found = record.controls([Control("x", True, False, ("played: differs",)), Control("y", True, None)])
    assert {c.family: (c.cases, len(c.red)) for c in found} == {
        "told": (2, 0),
        "read": (2, 0),
        "formula": (1, 1),
        "source": (1, 1),
    }


def test_faults_done_are_found_again_after_a_kill(tmp_path: Path) -> None:
    one, other = _fault("a", "x"), _fault("b")
    record.planted(tmp_path).add("key a", one)
    with (tmp_path / "planted.jsonl").open("ab") as file:
        file.write(b'{"key": "key b", "res')  # killed here
    record.planted(tmp_path).add("key b", other)
    again = record.planted(tmp_path)
    assert [again.get(key) for key in ("key a", "key b", "other sources a")] == [one, other, None]
    with record.planted(tmp_path).resumed(False):
        assert record.planted(tmp_path).get("key a") is None


@pytest.mark.lammps
def test_page_holds_faults_whatever_they_are_called(tmp_path: Path) -> None:
    page.write(_power(_fault("<b>", "case<i>"), _fault("quiet")), tmp_path)
    text = (tmp_path / "power.html").read_text()
    assert "told.&lt;b&gt;" in text
    assert "<i>" not in text
    assert "not known" in text
    assert "://" not in text.replace("http://www.w3.org", "")


# --- the command


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command knows two cases."""
    monkeypatch.setattr(casefile, "load", lambda *_: [CASES[LAW], replace(CASES[FLUID], tags=("model",))])


Command = Callable[..., Outcome]


@pytest.mark.lammps
@pytest.mark.usefixtures("few")
def test_command_goes_on_where_it_was_left(eos_ref_command: Command, tmp_path: Path) -> None:
    out = tmp_path / "power"
    asked = ("power", "told.cs-off", "told.power-n", "told.kappa-off", "--out", out, "--jobs", 1)
    first = eos_ref_command(*asked, "--json")
    assert first.code == 1  # no case conducts heat
    found = json.loads(first.out)
    assert {fault["id"]: fault["caught_by"] for fault in found["faults"]} == {
        "told.cs-off": [LAW, FLUID],
        "told.power-n": [FLUID],
        "told.kappa-off": [],
    }
    assert found["resolution"] == []
    assert found["rates"] == {"faults": 3, "caught": 2, "caught_by_quick": 1}
    kept = (out / "planted.jsonl").read_bytes()
    again = eos_ref_command(*asked)
    assert again.code == 1
    assert "unseen: told.kappa-off" in again.out and again.out.endswith("\nFAIL: 1 complaint\n")
    assert (out / "planted.jsonl").read_bytes() == kept
    assert json.loads((out / "power.json").read_text())["faults"] == found["faults"]
    clean = eos_ref_command("power", "told.cs-off", "--out", out, "--jobs", 1, "--fail-on", "low")
    assert clean.code == 0 and clean.out.endswith("\nPASS: all checks as required\n")


@pytest.mark.lammps
def test_bad_input_is_one_line(eos_ref_command: Command, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for arguments in (("nothing.*",), ("told.cs-off", "--out", tmp_path / "file" / "x"), ("--sample", "0")):
        left = eos_ref_command("power", "--out", tmp_path / "power", *arguments)
        assert left.code == 2
        assert len(left.err.strip().splitlines()) == 1


def test_fault_says_its_family() -> None:
    assert Fault("source.laws.x-1", "source", "x").family == "source"


@pytest.mark.slow
def test_mistakes_that_are_findings_are_no_faults() -> None:
    left_out = set(formula.faults()) - set(catalogue.faults())
    assert left_out == {"formula.lint-velocity-of-walls-lost", "formula.lint-no-volume-in-the-force"}, "findings"


def test_without_lammps_it_says_so(eos_ref_command: Command, tmp_path: Path) -> None:
    (tmp_path / "build").mkdir()
    left = eos_ref_command(
        "power", "told.cs-off", "--engine", f"path:{tmp_path / 'build'}", "--out", tmp_path / "power"
    )
    assert left.code in (2, 3)
    assert len(left.err.strip().splitlines()) == 1
