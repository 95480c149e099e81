"""Triage of a red run: groups of one first cause, features common to their scenes and absent in green ones, hypotheses.

Cases are grouped by how they ended, or by the first step, stage and field outside the bound. A group in which some
hypothesis reproduces only a part of the cases is split: the rest is its own group.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref import InputError
from lammps_cases.comparison.changed import PLAIN
from lammps_cases.comparison.predictor import Made, Predictor
from lammps_cases.findings import LEDGER
from lammps_cases.findings.variants import combined
from lammps_cases.records import case_wording
from lammps_cases.records.faults import part
from lammps_cases.records.run_record import CaseRecord, Hypothesis, RunRecord, Triage, TriageGroup
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import build, seed
from lammps_cases.scene.casefile import Case
from lammps_cases.verdict.case_arrays import read_steps
from lammps_cases.verdict.diagnosis import laws
from lammps_cases.verdict.diagnosis.trials import HypothesisSearch, RedCase, Tried, Work, red_case, survivors_of
from lammps_cases.verdict.problems import problem_of

LONGEST = 3  # features that are named together
MANY = 60  # features combined; those of the fewest green scenes come first
SECONDS = 30.0  # estimated work on hypotheses
STARTS = 3  # cases of a group, at most, whose formulas are searched from the beginning
TRIED = 12  # hypotheses of one case that are tried on the others of its group
NAMED = 6  # hypotheses named for each group; the others are counted
Key = tuple[str, ...]


def features(scene: Scene) -> set[str]:
    """Return the features of a scene: the keys of its file that it sets, their words, and how its types differ."""
    content = scene.model_dump(mode="json", exclude_defaults=True, exclude={"compare", "types", "pressure", "forces"})
    found = {f"dimension {scene.dimension}", f"units {scene.units}", f"kernel {scene.rheo.kernel}", *_keys(content)}
    found |= {f"law {law.style}" for law in scene.pressure} | {f"fix {force.style}" for force in scene.forces}
    found.add(f"{len(scene.types)} type{'s' * (len(scene.types) > 1)}")
    types = [of_type.model_dump(mode="json", exclude_defaults=True) for of_type in scene.types]
    for key in {key for of_type in types for key in of_type}:
        found |= {name for of_type in types if key in of_type for name in _keys({key: of_type[key]})}
        if len({repr(of_type.get(key)) for of_type in types}) > 1:
            found.add(f"types of different `{key}`")
    return found | ({f"comparing `{name}`" for name in scene.compare} if scene.whole_model else set())


def _keys(content: Mapping[str, Any], path: str = "") -> Iterator[str]:
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _keys(value, f"{path}{key}.")
        if value not in (None, False, [], {}):
            yield f"`{path}{key}`"
        if isinstance(value, str | bool) and value is not True:
            yield f"`{path}{key}` {str(value).lower() if value is False else value}"


@dataclass(frozen=True)
class Common:
    """Features common to all red scenes, and the number of green ones that also have them all."""

    features: tuple[str, ...]
    green: int


def in_common(red: Sequence[set[str]], green: Sequence[set[str]]) -> Common:
    """Return the fewest features that all red scenes have together and the fewest green ones.

    A combination is used only if it leaves fewer green scenes than any shorter one.
    """
    shared = sorted(set.intersection(*red)) if red else []
    table = {name: np.array([name in scene for scene in green], bool) for name in shared}
    # Features of the fewest green scenes tell most; among equals properties of the model precede compared fields.
    ranked = sorted(shared, key=lambda name: (int(table[name].sum()), name.startswith("comparing"), name))[:MANY]
    best = Common((), len(green))
    for size in range(1, LONGEST + 1):
        for names in itertools.combinations(ranked, size):
            both: Any = np.logical_and.reduce([table[name] for name in names])
            left = int(both.sum())
            if left < best.green:
                best = Common(names, left)
        if best.green == 0:
            break
    return best


def triage(
    run: RunRecord,
    cases: Iterable[Case],
    fields: Path,
    predictor: Predictor | None = None,
    seconds: float = SECONDS,
) -> Triage | None:
    """Return the triage of a run; None if everything is as expected.

    Parameters
    ----------
    cases : those of the run; the features of scenes leave out any case not among them
    fields : folder of the run's arrays
    seconds : of estimated work on hypotheses
    """
    red = [record for record in run.cases if not record.as_expected and not record.limits]  # limits: the cause is known
    if not red:
        return None
    by_name = {case.name: case for case in cases}
    found_in = {record.case: features(by_name[record.case].scene) for record in run.cases if record.case in by_name}
    every = set().union(*found_in.values())
    found_in = {case: found | {f"no {name}" for name in every - found} for case, found in found_in.items()}
    green = [
        found_in[record.case]
        for record in run.cases
        if record.as_expected and record.verdict != "skipped" and record.case in found_in
    ]
    members: dict[Key, list[CaseRecord]] = defaultdict(list)
    for record in red:
        members[_key(record)].append(record)
    in_order = sorted(members.values(), key=lambda records: (-len(records), _key(records[0])))
    diagnosis = _Diagnosis(by_name, fields, predictor or Predictor(), seconds)
    groups: list[TriageGroup] = []
    for at, records in enumerate(in_order):
        names = [record.case for record in records]
        work = Work(diagnosis.left / (len(in_order) - at))
        search = partial(diagnosis.parts, records, work)
        for found in part("hypotheses", run.faults, search, [_Part(_group(records), records)], names):
            common = in_common([found_in[r.case] for r in found.records if r.case in found_in], green)
            groups.append(
                found.group.model_copy(
                    update={"common": list(common.features), "green_with": common.green, "green": len(green)}
                )
            )
    return Triage(groups=sorted(groups, key=lambda group: -len(group.cases)))


def _key(record: CaseRecord) -> Key:
    first = record.headline
    if first is None:
        return record.verdict, record.ended, case_wording.error_text(record.engine_error)
    when = "" if first.step is None else "later" if first.step else "first"  # a case of laws has no steps
    return record.verdict, first.stage, first.field, when, record.twin


@dataclass
class _Part:
    group: TriageGroup
    records: list[CaseRecord]


@dataclass
class _Diagnosis:
    cases: Mapping[str, Case]
    fields: Path
    predictor: Predictor
    left: float
    _kept: dict[tuple[str, tuple[str, ...]], RedCase | None] = field(default_factory=dict)
    _found: list[Tried] = field(default_factory=list)  # changes that reproduce another group: the fault may be the same

    def parts(self, records: Sequence[CaseRecord], work: Work) -> list[_Part]:
        """Return the groups into which records of one first cause are divided."""
        begin = work.left
        scene = self.cases[records[0].case].scene if records[0].case in self.cases else None
        if scene is None or records[0].twin or records[0].blame is None:
            parts = [_Part(_group(records), list(records))]
        elif scene.whole_model:
            parts = list(self._of_model(records, work))
        else:
            parts = list(self._of_laws(records))
        self.left -= begin - max(work.left, 0.0)
        return parts

    def _of_laws(self, records: Sequence[CaseRecord]) -> Iterator[_Part]:
        rest = list(records)
        while rest:
            tried, reproduced = laws.hypotheses(rest, self.cases, self.fields)
            own = [record for record in rest if record.case in reproduced.cases]
            named = [Hypothesis(sentence=sentence) for sentence in reproduced.sentences]
            yield _Part(_group(own or rest, named, tried), own or rest)
            if not own:
                return
            rest = [record for record in rest if record not in own]

    def _of_model(self, records: Sequence[CaseRecord], work: Work) -> Iterator[_Part]:
        rest, tried, spent, starts = list(records), 0, False, 0
        unexplained: list[CaseRecord] = []
        while rest and starts < STARTS and not spent:
            ready = [(started[0], record) for record in rest if (started := self._started(record))]
            if not ready:
                break
            own = min(ready, key=lambda pair: pair[0].size)[1]
            starts += 1
            begun = self._started(own)
            reproduced, named = self._reproduced(self._found, own, rest, work)
            if reproduced:
                yield _Part(_group(reproduced, named, tried := tried + len(self._found)), reproduced)
            share = work.left / len(begun)  # a case without a pair takes nothing from the others
            searches = [HypothesisSearch(case, Work(share)) for case in begun]
            found = () if reproduced else survivors_of(searches)
            for survivors in filter(None, found):
                reproduced, named = self._reproduced(survivors, own, rest, work)
                if reproduced:
                    self._found += [changes for changes in survivors if changes not in self._found]
                    break
            tried, spent = tried + sum(each.tried for each in searches), any(each.spent for each in searches)
            if reproduced and found:
                yield _Part(_group(reproduced, named, tried, spent), reproduced)
            work.left -= sum(share - max(search.work.left, 0.0) for search in searches)
            rest = [record for record in rest if record not in reproduced]
            if not reproduced:
                unexplained.append(own)
                rest.remove(own)
        if rest or unexplained:
            yield _Part(_group([*unexplained, *rest], (), tried, spent), [*unexplained, *rest])

    def _reproduced(
        self, survivors: Sequence[Tried], own: CaseRecord, records: Sequence[CaseRecord], work: Work
    ) -> tuple[list[CaseRecord], list[Hypothesis]]:
        """Return the most cases reproduced by changes that reproduce one case, and these changes."""
        holds = {
            at: frozenset(record.case for record in records if self._holds(changes, record, work))
            for at, changes in enumerate(survivors[:TRIED])
        }
        best = max((names for names in holds.values() if own.case in names), key=len, default=frozenset())
        named = [survivors[at] for at, names in holds.items() if best and names == best]
        sentences = [" and ".join(change.sentence for change in changes) for changes in named]
        return [record for record in records if record.case in best], [Hypothesis(sentence=s) for s in sentences]

    def _holds(self, changes: Tried, record: CaseRecord, work: Work) -> bool:
        return any(case.reproduced(changes, Work(max(work.left, 1.0))) for case in self._started(record))

    def _started(self, record: CaseRecord) -> list[RedCase]:
        """Return a case with the findings with which it is red latest: the ones that come furthest, or none."""
        beyond = record.beyond
        others = tuple(dict.fromkeys(beyond.known + beyond.findings)) if beyond else ()
        bases = (others, ()) if others else ((),)
        made = [case for base in bases if (case := self._red(record, base)) is not None]
        last = max((case.place for case in made), default=None)
        return [case for case in made if case.place == last]

    def _red(self, record: CaseRecord, base: tuple[str, ...]) -> RedCase | None:
        key = record.case, base
        if key not in self._kept:
            self._kept[key] = self._read(record, base)
        return self._kept[key]

    def _read(self, record: CaseRecord, base: tuple[str, ...]) -> RedCase | None:
        case = self.cases.get(record.case)
        snapshots = None if case is None else read_steps(self.fields, record.case, case.scene)
        if case is None or snapshots is None:
            return None
        try:
            atoms = build(case, case.scene.eos(case.where))
            problem = problem_of(case.scene, atoms, case.where, case.scene.snapshots)
            variants = [e.model_variant for e in LEDGER if e.id in base and e.model_variant]
            if any(variant.lists for variant in variants):
                return None
            made: Made | None = combined(variants, problem, snapshots[0]) if variants else PLAIN
            if made is None:
                return None
            return red_case(record.case, problem, snapshots, made, seed(f"{record.case}/moved runs"), self.predictor)
        except InputError:  # the case has changed since it ran
            return None


def _group(
    records: Sequence[CaseRecord], hypotheses: Sequence[Hypothesis] = (), tried: int = 0, spent: bool = False
) -> TriageGroup:
    one = records[0]
    first = one.headline
    steps = [blame.step for r in records if (blame := r.headline) and blame.step is not None]
    return TriageGroup(
        cases=sorted(record.case for record in records),
        verdict=one.verdict,
        twin=one.twin,
        stage=first.stage if first else "",
        field=first.field if first else "",
        step=min(steps, default=None),
        text="" if first else case_wording.end(one) or one.message,
        hypotheses=list(hypotheses[:NAMED]),
        more=max(0, len(hypotheses) - NAMED),
        tried=tried,
        cut_short=spent,
    )
