"""Judgements of answers that LAMMPS gave before, bit for bit: nobody needs to judge those again.

LAMMPS is asked everything that it is asked in a first run. What is looked up is the judgement of its answer, by all
that follows from: the case, the arrays that LAMMPS returned, its neighbour lists if they are read, the release whose
findings are known, and all code and data of this package. Only what is as expected is kept; what differs is judged
each time.
"""

from __future__ import annotations

import contextlib
import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lammps_cases.comparison.prediction_keys import fingerprint
from lammps_cases.comparison.store import Arrays, Store
from lammps_cases.engine.session import Answer
from lammps_cases.records.files import write_atomically
from lammps_cases.records.run_record import CaseRecord, EngineRecord, Predictions, Seconds
from lammps_cases.run.answers import Answers
from lammps_cases.run.case_journal import CaseJournal, code, said
from lammps_cases.run.prepared_case import Outcomes

_code = functools.cache(code)  # of this process: sources may have changed since the run began
_RECORD = "record"
_LISTS = "lists"  # an entry with this name alone: the judgement is that of the answer with its lists


def judgement_store(predictions: Store | None, code: str) -> Store | None:
    """Return where the judgements by some code lie, beside the predictions; None if there is no store."""
    return Store(predictions.folder, f"judgements/{code}", predictions.fresh) if predictions else None


def current(judgements: Store) -> bool:
    """Return whether judgements are those of the code of this process.

    A worker that starts after an edit is not of the code that its run began with; one that started before may import
    the rest of it later. None of them looks up or keeps a judgement.
    """
    return judgements.context == f"judgements/{_code()}"


@dataclass(frozen=True)
class JudgedBefore:
    """The judgement of a case, in a store, and in the folder of a report.

    Attributes
    ----------
    store : where judgements lie
    key : what LAMMPS was asked and answered
    lammps : seconds that it took this time
    """

    store: Store
    key: str
    lammps: float

    @classmethod
    def of(cls, store: Store, answers: Answers, engine: EngineRecord) -> JudgedBefore | None:
        """Return where the judgement of LAMMPS' answers lies; None for failures, which are judged at once."""
        given = [outcome for outcome in answers.outcomes if isinstance(outcome, Answer)]
        if len(given) < len(answers.outcomes):
            return None
        ready = answers.ready
        case = ready.case.name, said(ready.case), ready.case.shipped, ready.atoms
        key = fingerprint(*case, engine.name, engine.distribution, [_returned(answer) for answer in given])
        return cls(store, key, sum(answer.seconds for answer in given))

    def find(self, folder: Path, answers: Answers) -> CaseRecord | None:
        """Return the record, and put its arrays into a folder; None: to be judged.

        LAMMPS is run again for its neighbour lists, if answers with these were judged.
        """
        entry = self.store.read(self.key)
        if entry is not None and _LISTS in entry:
            lists: list[Any] = []
            with contextlib.suppress(Exception):  # judging runs LAMMPS again, and reports the failure
                lists = [answer.lists for answer in answers.with_lists() if isinstance(answer, Answer)]
            entry = self.store.read(self._with(lists)) if lists else None
        return None if entry is None else self._restored(folder, entry)

    def keep(self, folder: Path, record: CaseRecord, listed: Outcomes) -> None:
        """Keep a record whose arrays lie in a folder; ``listed``: the answers with lists, if these were judged."""
        contents = {path.name: path.read_bytes() for path in CaseJournal(folder).arrays(record.case)}
        contents[_RECORD] = record.model_dump_json(by_alias=True).encode()
        entry = {name: np.frombuffer(content, np.uint8) for name, content in contents.items()}
        lists = [answer.lists for answer in listed if isinstance(answer, Answer)]
        if lists:
            self.store.write(self.key, {_LISTS: np.array(len(lists))})
        self.store.write(self._with(lists) if lists else self.key, entry)

    def _restored(self, folder: Path, entry: Arrays) -> CaseRecord:
        contents = {name: array.tobytes() for name, array in entry.items()}
        record = CaseRecord.model_validate_json(contents.pop(_RECORD))
        for name, arrays in contents.items():
            write_atomically(folder / "fields" / name, arrays)
        record.seconds = Seconds(lammps=self.lammps, total=self.lammps)
        predictions = record.predictions.computed + record.predictions.stored
        record.predictions = Predictions(stored=predictions, judgements=1)
        return record

    def _with(self, lists: Any) -> str:
        return fingerprint(self.key, _plain(lists))


def _returned(answer: Answer) -> tuple[Any, ...]:
    """Return all of an answer that is judged: not how long it took."""
    carried = [(each.before, each.after) for each in answer.carried]
    parts: tuple[Any, ...] = _plain((answer.arrays, answer.snapshots, answer.steps, answer.lists, carried))
    return parts


def _plain(part: Any) -> Any:
    """Return dictionaries, wherever they are in sequences, as sequences."""
    if isinstance(part, dict):
        return tuple((name, _plain(value)) for name, value in sorted(part.items()))
    return tuple(_plain(each) for each in part) if isinstance(part, tuple | list) else part
