"""An answer that was judged before is not judged again; one that differs in any bit is."""

from __future__ import annotations

import errno
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lammps_cases.comparison import store as store_module
from lammps_cases.comparison.store import Store, code, current, open_store
from lammps_cases.engine.session import Answer, Job
from lammps_cases.engine.workers import Failure
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.run import flow, judged, prepared_case
from lammps_cases.run.judged import JudgedBefore
from lammps_cases.run.prepared_case import Answers, Outcomes, PreparedCase, prepare
from lammps_cases.scene import casefile
from tests.support.outcome import Solver

pytestmark = pytest.mark.lammps

ENGINE = EngineRecord(distribution="2025.7.22.4.0")
CASES = {case.name: case for case in casefile.load()}
PLAIN, STOPS, LISTED, TWIN = "forces.all.quintic.2d", "runs.fluid.atoms", "deformed.walls.remap", "twins.walls.boost"


@pytest.fixture(scope="module")
def answered(solver: Solver) -> Callable[[str], tuple[PreparedCase, Outcomes]]:
    """Return LAMMPS' answers to a case, computed once."""
    known: dict[str, tuple[PreparedCase, Outcomes]] = {}

    def ask(name: str) -> tuple[PreparedCase, Outcomes]:
        if name not in known:
            ready = prepare(CASES[name])
            known[name] = ready, [solver(job) for job in ready.jobs]
        return known[name]

    return ask


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, solver: Solver) -> list[Job]:
    """Jobs given to LAMMPS while a case is judged."""
    jobs: list[Job] = []

    def solve(site: str | None, job: Job) -> Answer:
        jobs.append(job)
        return solver(job)

    monkeypatch.setattr(prepared_case, "solve", solve)
    return jobs


@pytest.fixture
def store(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Store:
    monkeypatch.setenv("EOS_REF_PREDICTIONS", str(tmp_path / "store"))
    return open_store()


def judged_into(
    folder: Path, ready: PreparedCase, outcomes: Outcomes, of: Store | None, run_code: str = ""
) -> CaseRecord:
    kept = replace(of, context=run_code or store_module.code()) if of else None
    return flow.record_case(None, folder, ready, outcomes, ENGINE, of, kept)


def _files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((folder / "fields").iterdir())}


def _told(record: CaseRecord) -> dict[str, Any]:
    """Return a record without times and the origin of predictions."""
    told: dict[str, Any] = json.loads(record.model_dump_json(exclude={"seconds", "predictions"}))
    return told


def _never(*arguments: object) -> Any:
    raise AssertionError("judged again")


@pytest.mark.parametrize("name", [PLAIN, STOPS, LISTED, TWIN])
def test_known_answer_is_not_judged_again_and_gives_the_same_record(
    name: str,
    answered: Callable[[str], tuple[PreparedCase, Outcomes]],
    asked: list[Job],
    store: Store,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ready, outcomes = answered(name)
    first = judged_into(tmp_path / "first", ready, outcomes, store)
    read = len(asked)
    assert (name == LISTED) == bool(read)
    assert first.predictions.judgements == 0
    monkeypatch.setattr(flow, "_judged", _never)
    second = judged_into(tmp_path / "second", ready, outcomes, store)
    assert len(asked) == 2 * read  # LAMMPS runs once more for its lists
    assert _told(second) == _told(first)
    assert _files(tmp_path / "second") == _files(tmp_path / "first")
    assert second.predictions.judgements == 1
    assert second.predictions.stored == first.predictions.computed + first.predictions.stored
    assert second.seconds.lammps == first.seconds.lammps


def _changed(answer: Answer) -> Iterator[tuple[str, Answer]]:
    """Yield answers that differ in the last bit of one number, with its place."""
    for name in answer.arrays:
        yield f"arrays {name}", replace(answer, arrays=_other(answer.arrays, name))
    for k, arrays in enumerate(answer.snapshots):
        for name in arrays:
            others = list(answer.snapshots)
            others[k] = _other(arrays, name)
            yield f"snapshot {k} {name}", replace(answer, snapshots=tuple(others))
    for k, arrays in enumerate(answer.lists):
        for name in arrays:
            yield f"list {k} {name}", replace(answer, lists=(*answer.lists[:k], _other(arrays, name)))
    for k, carried in enumerate(answer.carried):
        for name in carried.before:
            before = replace(carried, before=_other(carried.before, name))
            yield f"before {k} {name}", replace(answer, carried=(*answer.carried[:k], before))
        for name in carried.after:
            after = replace(carried, after=_other(carried.after, name))
            yield f"after {k} {name}", replace(answer, carried=(*answer.carried[:k], after))
    yield "steps", replace(answer, steps=(*answer.steps[:-1], answer.steps[-1] + 1))


def _other(arrays: dict[str, Any], name: str) -> dict[str, Any]:
    array = np.array(arrays[name])
    raw = bytearray(array.tobytes())
    raw[-array.itemsize] ^= 1  # the last bit of the last number
    return {**arrays, name: np.frombuffer(raw, array.dtype).reshape(array.shape)}


@pytest.mark.parametrize("name", [PLAIN, STOPS])
def test_every_returned_bit_counts(
    name: str, answered: Callable[[str], tuple[PreparedCase, Outcomes]], store: Store
) -> None:
    ready, [answer] = answered(name)
    assert isinstance(answer, Answer)
    assert bool(answer.carried) == (name == STOPS)
    own = JudgedBefore.of(store, Answers(None, ready, [answer]), ENGINE)
    assert own is not None
    keys = {"own": own.key}
    for where, other in _changed(answer):
        changed = JudgedBefore.of(store, Answers(None, ready, [other]), ENGINE)
        assert changed is not None
        keys[where] = changed.key
    assert len(set(keys.values())) == len(keys) > len(answer.arrays) + 2
    again = JudgedBefore.of(store, Answers(None, ready, [replace(answer, seconds=7.0, run_seconds=(7.0,))]), ENGINE)
    assert again is not None
    assert again.key == own.key  # times do not count


def test_case_and_engine_count(answered: Callable[[str], tuple[PreparedCase, Outcomes]], store: Store) -> None:
    ready, outcomes = answered(PLAIN)
    case, atoms = ready.case, ready.atoms
    moved = replace(atoms, mass_n=np.nextafter(atoms.mass_n, 9.0))
    others = [
        (replace(ready, case=replace(case, name="another")), ENGINE),
        (replace(ready, case=replace(case, about="something else")), ENGINE),
        (replace(ready, case=replace(case, exercises=("images",))), ENGINE),
        (replace(ready, case=replace(case, scene=case.scene.model_copy(update={"compare": ("f",)}))), ENGINE),
        (replace(ready, atoms=moved), ENGINE),
        (ready, EngineRecord(distribution="2025.7.22.1.0")),
        (ready, EngineRecord(name="path:elsewhere", distribution="2025.7.22.4.0")),
        (ready, ENGINE),
    ]
    found = [JudgedBefore.of(store, Answers(None, other, outcomes), engine) for other, engine in others]
    assert len({each.key for each in found if each}) == len(others)


def test_different_lists_are_judged_again(
    answered: Callable[[str], tuple[PreparedCase, Outcomes]],
    asked: list[Job],
    store: Store,
    tmp_path: Path,
) -> None:
    ready, outcomes = answered(LISTED)
    before = _before(store, ready, outcomes)
    judged_into(tmp_path, ready, outcomes, store)
    (every,) = Answers(None, ready, outcomes).with_lists()
    assert isinstance(every, Answer)
    assert before.find(tmp_path, SimpleNamespace(with_lists=lambda: [every])) is not None
    for where, other in _changed(every):
        if where.startswith("list"):
            changed = SimpleNamespace(with_lists=partial(list, [other]))
            assert before.find(tmp_path, changed) is None, where
    assert (
        before.find(tmp_path, SimpleNamespace(with_lists=list)) is None
    )  # LAMMPS ran differently when they were requested


def _before(store: Store, ready: PreparedCase, outcomes: Outcomes) -> JudgedBefore:
    kept = replace(store, context=code())
    before = JudgedBefore.of(kept, Answers(None, ready, outcomes), ENGINE)
    assert before is not None
    return before


def test_only_expected_outcomes_are_kept(
    answered: Callable[[str], tuple[PreparedCase, Outcomes]], asked: list[Job], store: Store, tmp_path: Path
) -> None:
    ready, [answer] = answered(PLAIN)
    assert isinstance(answer, Answer)

    spoilt: Outcomes = [
        replace(answer, snapshots=tuple({**each, "rho": 1.1 * each["rho"]} for each in answer.snapshots))
    ]
    for _ in range(2):
        record = judged_into(tmp_path, ready, spoilt, store)
        assert record.verdict == "differs"
        assert record.predictions.judgements == 0
    assert JudgedBefore.of(store, Answers(None, ready, [Failure("crashed", "it died")]), ENGINE) is None


def test_fresh_run_and_other_code_find_nothing(
    answered: Callable[[str], tuple[PreparedCase, Outcomes]],
    asked: list[Job],
    store: Store,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ready, outcomes = answered(PLAIN)

    def judgements(of: Store | None) -> int:
        record = judged_into(tmp_path, ready, outcomes, of)
        return record.predictions.judgements

    assert [judgements(each) for each in (store, store, open_store(fresh=True), store, None)] == [0, 1, 0, 1, 0]
    monkeypatch.setattr(store_module, "code", lambda *_: "another")
    assert judgements(store) == 0


def test_process_with_other_code_uses_no_stored_judgements(
    answered: Callable[[str], tuple[PreparedCase, Outcomes]],
    asked: list[Job],
    store: Store,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A worker that started after an edit, or imported modules after it."""
    ready, outcomes = answered(PLAIN)
    of_run = code()
    for of_process in ("edited", of_run, of_run):
        monkeypatch.setattr(store_module, "code", lambda *_, code=of_process: code)
        current.cache_clear()
        record = judged_into(tmp_path, ready, outcomes, store, of_run)
        edited = of_process != of_run
        assert record.predictions.judgements == 0 if edited else record.predictions.computed == 0
    assert record.predictions.judgements == 1, "the second was kept, the first was not"


@pytest.mark.parametrize("kept", [False, True])
def test_lists_that_cannot_be_read_leave_no_verdict(
    kept: bool,
    answered: Callable[[str], tuple[PreparedCase, Outcomes]],
    asked: list[Job],
    store: Store,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The verdict depends on them: a full disk is not a difference of LAMMPS, with or without a stored judgement."""
    ready, outcomes = answered(LISTED)
    if kept:
        judged_into(tmp_path, ready, outcomes, store)

    def full(*_: object) -> Answer:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(prepared_case, "solve", full)
    record = judged_into(tmp_path, ready, outcomes, store)
    assert record.verdict == "error"
    assert "neighbour lists: [Errno 28] No space left on device" in record.message


@pytest.mark.parametrize("moved", ["from tags to rules", "within the text"])
def test_key_keeps_the_parts_of_a_case_apart(
    moved: str, answered: Callable[[str], tuple[PreparedCase, Outcomes]], store: Store
) -> None:
    ready, outcomes = answered(PLAIN)
    one, other = (
        (replace(ready.case, tags=("a", "b"), exercises=()), replace(ready.case, tags=("a",), exercises=("b",)))
        if moved == "from tags to rules"
        else (replace(ready.case, about="a\0b", tags=()), replace(ready.case, about="a", tags=("b",)))
    )
    keys = [JudgedBefore.of(store, Answers(None, replace(ready, case=case), outcomes), ENGINE) for case in (one, other)]
    assert keys[0] != keys[1]
    run = RunRecord(engine=ENGINE, reference={}, date="d")
    assert judged.start(run, [one]).cases != judged.start(run, [other]).cases


def test_damaged_judgement_is_made_again(
    answered: Callable[[str], tuple[PreparedCase, Outcomes]], asked: list[Job], store: Store, tmp_path: Path
) -> None:
    ready, outcomes = answered(PLAIN)
    first = judged_into(tmp_path, ready, outcomes, store)
    for path in store.folder.iterdir():
        path.write_bytes(path.read_bytes()[:-1] + b"?")
    second = judged_into(tmp_path, ready, outcomes, store)
    assert second.predictions.judgements == 0
    assert _told(second) == _told(first)


def test_worker_without_the_files_of_a_case_judges_it_nevertheless(
    answered: Callable[[str], tuple[PreparedCase, Outcomes]], store: Store
) -> None:
    ready, outcomes = answered("files.extxyz")
    elsewhere = replace(ready, case=replace(ready.case, source=Path("elsewhere") / "droplet.yaml"))
    assert JudgedBefore.of(store, Answers(None, elsewhere, outcomes), ENGINE) is not None
