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
from lammps_cases.comparison.store import Store, current, open_store
from lammps_cases.engine.session import Answer, Job
from lammps_cases.engine.workers import Failure, KeptAnswer
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
Answered = Callable[[str], tuple[PreparedCase, Outcomes]]


@pytest.fixture(scope="module")
def answered(solver: Solver) -> Answered:
    """LAMMPS' answers to a case, computed once."""
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


@pytest.fixture
def judge(tmp_path: Path, store: Store) -> Callable[..., CaseRecord]:
    """Judge a case with the store, another or None, in a folder."""

    def judge(
        ready: PreparedCase, outcomes: Outcomes, folder: str = "", of: Store | None = store, run_code: str = ""
    ) -> CaseRecord:
        kept = replace(of, context=run_code or store_module.code()) if of else None
        return flow.record_case(None, tmp_path / folder, ready, outcomes, ENGINE, of, kept)

    return judge


def before(store: Store, ready: PreparedCase, outcomes: Outcomes, engine: EngineRecord = ENGINE) -> JudgedBefore:
    found = JudgedBefore.of(replace(store, context=store_module.code()), Answers(None, ready, outcomes), engine)
    assert found is not None
    return found


def _files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((folder / "fields").iterdir())}


def _told(record: CaseRecord) -> dict[str, Any]:
    """Return a record without times and the origin of predictions."""
    told: dict[str, Any] = json.loads(record.model_dump_json(exclude={"seconds", "predictions"}))
    return told


@pytest.mark.parametrize("name", [PLAIN, STOPS, LISTED, TWIN])
def test_known_answer_is_not_judged_again_and_gives_the_same_record(
    name: str,
    answered: Answered,
    asked: list[Job],
    judge: Callable[..., CaseRecord],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ready, outcomes = answered(name)
    first = judge(ready, outcomes, "first")
    read = len(asked)
    assert (name == LISTED) == bool(read)
    assert first.predictions.judgements == 0
    monkeypatch.delattr(flow, "_judged")
    second = judge(ready, outcomes, "second")
    assert len(asked) == 2 * read  # LAMMPS runs once more for its lists
    assert _told(second) == _told(first)
    assert _files(tmp_path / "second") == _files(tmp_path / "first")
    assert second.predictions.judgements == 1
    assert second.predictions.stored == first.predictions.computed + first.predictions.stored
    assert second.seconds.lammps == first.seconds.lammps


def test_deleted_answer_is_requested_again(answered: Answered, asked: list[Job], tmp_path: Path) -> None:
    """A cleaner of temporary files may delete answers while a run waits."""
    gone = KeptAnswer(tmp_path / "answer")
    record = flow.record_case(None, tmp_path, prepare(CASES["near-rho0.linear.2d"]), [gone], EngineRecord())
    assert record.verdict == "exact" and len(asked) == 1
    prepared_case.discard([gone])


def _changed(answer: Answer) -> Iterator[tuple[str, Answer]]:
    """Yield answers that differ in the last bit of one number, with its place."""
    for name in answer.arrays:
        yield f"arrays {name}", replace(answer, arrays=_other(answer.arrays, name))
    for part in ("snapshots", "lists"):
        for k, arrays in enumerate(of := getattr(answer, part)):
            for name in arrays:
                others = (*of[:k], _other(arrays, name), *of[k + 1 :])
                yield f"{part} {k} {name}", replace(answer, **{part: others})
    for k, carried in enumerate(answer.carried):
        for side in ("before", "after"):
            for name in getattr(carried, side):
                moved = replace(carried, **{side: _other(getattr(carried, side), name)})
                yield f"{side} {k} {name}", replace(answer, carried=(*answer.carried[:k], moved))
    yield "steps", replace(answer, steps=(*answer.steps[:-1], answer.steps[-1] + 1))


def _other(arrays: dict[str, Any], name: str) -> dict[str, Any]:
    array = np.array(arrays[name])
    raw = bytearray(array.tobytes())
    raw[-array.itemsize] ^= 1  # the last bit of the last number
    return {**arrays, name: np.frombuffer(raw, array.dtype).reshape(array.shape)}


@pytest.mark.parametrize("name", [PLAIN, STOPS])
def test_every_returned_bit_counts(name: str, answered: Answered, store: Store) -> None:
    ready, [answer] = answered(name)
    assert isinstance(answer, Answer)
    assert bool(answer.carried) == (name == STOPS)
    own = before(store, ready, [answer]).key
    keys = [own, *(before(store, ready, [other]).key for _, other in _changed(answer))]
    assert len(set(keys)) == len(keys) > len(answer.arrays) + 2
    again = replace(answer, seconds=7.0, run_seconds=(7.0,))
    assert before(store, ready, [again]).key == own  # times do not count


def test_case_and_engine_count_and_parts_of_a_case_are_kept_apart(answered: Answered, store: Store) -> None:
    ready, outcomes = answered(PLAIN)
    case, atoms = ready.case, ready.atoms
    cases = [
        case,
        *(
            replace(case, **changes)
            for changes in (
                {"name": "another"},
                {"about": "something else"},
                {"exercises": ("images",)},
                {"scene": case.scene.model_copy(update={"compare": ("f",)})},
                {"tags": ("a", "b"), "exercises": ()},
                {"tags": ("a",), "exercises": ("b",)},
                {"about": "a\0b", "tags": ()},
                {"about": "a", "tags": ("b",)},
            )
        ),
    ]
    found = [before(store, replace(ready, case=other), outcomes) for other in cases]
    found.append(before(store, replace(ready, atoms=replace(atoms, mass_n=np.nextafter(atoms.mass_n, 9.0))), outcomes))
    engines = ({"distribution": "2025.7.22.1.0"}, {"name": "path:elsewhere", "distribution": ENGINE.distribution})
    found += [before(store, ready, outcomes, EngineRecord(**who)) for who in engines]
    assert len({each.key for each in found}) == len(found)
    run = RunRecord(engine=ENGINE, reference={}, date="d")
    assert len({str(judged.start(run, [one]).cases) for one in cases}) == len(cases)
    elsewhere, outcomes = answered("files.extxyz")  # a worker without the files of a case judges it nevertheless
    moved = replace(elsewhere.case, source=Path("elsewhere") / "droplet.yaml")
    assert before(store, replace(elsewhere, case=moved), outcomes)


def test_different_lists_are_judged_again(
    answered: Answered, asked: list[Job], store: Store, judge: Callable[..., CaseRecord], tmp_path: Path
) -> None:
    ready, outcomes = answered(LISTED)
    judge(ready, outcomes)
    (every,) = Answers(None, ready, outcomes).with_lists()
    assert isinstance(every, Answer)

    def found(*answers: Answer) -> bool:
        return (
            before(store, ready, outcomes).find(tmp_path, SimpleNamespace(with_lists=partial(list, answers)))
            is not None
        )

    assert found(every)
    others = {where: other for where, other in _changed(every) if where.startswith("list")}
    assert others and not [where for where, other in others.items() if found(other)]
    assert not found()  # LAMMPS ran differently when they were requested


def test_only_expected_outcomes_of_the_same_code_are_kept(
    answered: Answered,
    asked: list[Job],
    store: Store,
    judge: Callable[..., CaseRecord],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ready, [answer] = answered(PLAIN)
    assert isinstance(answer, Answer)
    spoilt = replace(answer, snapshots=tuple({**each, "rho": 1.1 * each["rho"]} for each in answer.snapshots))
    for _ in range(2):
        record = judge(ready, [spoilt])
        assert (record.verdict, record.predictions.judgements) == ("differs", 0)
    assert JudgedBefore.of(store, Answers(None, ready, [Failure("crashed", "it died")]), ENGINE) is None
    stores = (store, store, open_store(fresh=True), store, None)
    assert [judge(ready, [answer], of=each).predictions.judgements for each in stores] == [0, 1, 0, 1, 0]
    monkeypatch.setattr(store_module, "code", lambda *_: "another")
    assert judge(ready, [answer]).predictions.judgements == 0


def test_process_with_other_code_uses_no_stored_judgements(
    answered: Answered, asked: list[Job], judge: Callable[..., CaseRecord], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker that started after an edit, or imported modules after it."""
    ready, outcomes = answered(PLAIN)
    of_run = store_module.code()
    for of_process in ("edited", of_run, of_run):
        monkeypatch.setattr(store_module, "code", lambda *_, code=of_process: code)
        current.cache_clear()
        record = judge(ready, outcomes, run_code=of_run)
        edited = of_process != of_run
        assert record.predictions.judgements == 0 if edited else record.predictions.computed == 0
    assert record.predictions.judgements == 1, "the second was kept, the first was not"


@pytest.mark.parametrize("kept", [False, True])
def test_lists_that_cannot_be_read_leave_no_verdict(
    kept: bool,
    answered: Answered,
    asked: list[Job],
    judge: Callable[..., CaseRecord],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The verdict depends on them: a full disk is not a difference of LAMMPS, with or without a stored judgement."""
    ready, outcomes = answered(LISTED)
    if kept:
        judge(ready, outcomes)

    def full(*_: object) -> Answer:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(prepared_case, "solve", full)
    record = judge(ready, outcomes)
    assert record.verdict == "error"
    assert "neighbour lists: [Errno 28] No space left on device" in record.message


def test_damaged_judgement_is_made_again(
    answered: Answered, asked: list[Job], store: Store, judge: Callable[..., CaseRecord]
) -> None:
    ready, outcomes = answered(PLAIN)
    first = judge(ready, outcomes)
    for path in store.folder.iterdir():
        path.write_bytes(path.read_bytes()[:-1] + b"?")
    second = judge(ready, outcomes)
    assert second.predictions.judgements == 0
    assert _told(second) == _told(first)
