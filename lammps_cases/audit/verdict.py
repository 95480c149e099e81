"""From samples to the record of an audit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from lammps_cases.audit.effects import record_of
from lammps_cases.audit.effects import worst as largest
from lammps_cases.audit.fields import offered, out_of_scope
from lammps_cases.audit.messages import (
    CommandPlace,
    DeckEnd,
    DeckSetups,
    EngineIdentity,
    RunFacts,
    SampleRow,
    SampleRows,
)
from lammps_cases.engine.workers import Failure
from lammps_cases.findings import finding
from lammps_cases.records import case_wording, deck_wording, wording
from lammps_cases.records.case_parts import (
    ActingRecord,
    Blame,
    BreakRecord,
    BudgetRecord,
    CheckRecord,
    EffectRecord,
    FieldRecord,
    Seconds,
    worst,
)
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.verdict.outcome import leave_unchecked


@dataclass
class Findings:
    """The messages received so far from the process that runs the deck, combined."""

    place: CommandPlace = field(default_factory=lambda: CommandPlace("", ""))
    who: dict[str, str] = field(default_factory=dict)
    facts: RunFacts | None = None
    done: int = 0
    checks: list[CheckRecord] = field(default_factory=list)
    fields: dict[tuple[str, int], FieldRecord] = field(default_factory=dict)
    unchecked: dict[tuple[str, str], list[int]] = field(default_factory=dict)  # runs by field and reason
    chosen: set[str] = field(default_factory=set)
    effects: list[EffectRecord] = field(default_factory=list)
    budgets: list[BudgetRecord] = field(default_factory=list)
    unpredictable: dict[tuple[str, tuple[str, ...]], list[int]] = field(
        default_factory=dict
    )  # steps by field, findings
    sampled: tuple[int, int] = (0, 0)  # run and step of the last sample
    blame: Blame | None = None
    broke: BreakRecord | None = None
    ended: DeckEnd | None = None
    setups: DeckSetups | None = None

    def take(self, message: object) -> None:
        """Take one message."""
        match message:
            case CommandPlace():
                self.place = message
            case EngineIdentity():
                self.who = message.who
            case RunFacts():
                self.facts = message
                self.chosen |= message.stages.keys()
                for reason in message.unchecked.items():
                    self.unchecked.setdefault(reason, []).append(message.run)
            case SampleRows():
                self._sample(message)
            case DeckSetups():
                self.setups = message
            case DeckEnd():
                self.ended = message
                self.effects = largest(self.effects, message.effects)
                self.done = message.done
                self.broke = message.broke or self.broke

    def _sample(self, sample: SampleRows) -> None:
        self.done, self.sampled = sample.done, (sample.run, sample.step)
        for open_ in sample.unpredictable.items():
            self.unpredictable.setdefault(open_, []).append(sample.step)
        self.effects = largest(self.effects, sample.effects)
        self.budgets.extend(sample.budgets)
        for key, row in sample.rows.items():
            name, t = key
            values = {k: v for k, v in row._asdict().items() if k in CheckRecord.model_fields}
            self.checks.append(CheckRecord(step=sample.step, run=sample.run, field=name, type=t, **values))
            record = self._field(sample, key, row)
            self.fields[key] = _joined(self.fields[key], record) if key in self.fields else record
            if row.verdict == "differs" and self.blame is None:
                self.blame = _blame(sample, key, row)

    def _field(self, sample: SampleRows, key: tuple[str, int], row: SampleRow) -> FieldRecord:
        name, t = key
        facts = self.facts or NOTHING
        return FieldRecord(
            field=name,
            stage=facts.stages.get(name, "eos"),
            derivation=facts.derivations[t - 1] if t and facts.derivations else facts.derivation,
            atom_type=t or None,
            worst_step=sample.step,
            **{name: value for name, value in row._asdict().items() if name not in ("natoms", "digest")},
        )

    def reasons(self) -> dict[str, str]:
        """Return by field why it was not checked, with the runs if it was checked in others."""
        several = len({run for runs in self.unchecked.values() for run in runs} | {c.run for c in self.checks}) > 1
        compared = {name for name, _ in self.fields}
        missed = [name for name in offered() if name in self.chosen - compared and self.checks]
        of_runs = [
            (name, reason + (f" (run {', '.join(map(str, runs))})" if several else ""))
            for (name, reason), runs in self.unchecked.items()
        ]
        open_ = [
            (name, case_wording.not_predictable(steps, names)) for (name, names), steps in self.unpredictable.items()
        ]
        missed = [name for name in missed if not any(name == field for field, _ in self.unpredictable)]
        return by_field([*of_runs, *open_, *((name, NEVER_COMPARABLE) for name in missed)])

    def case(self, name: str, failure: Failure | None = None) -> CaseRecord:
        """Make the record; ``failure``: how LAMMPS ended, if it failed."""
        ended = self.ended or DeckEnd(self.done, 0, Seconds(), [], [], {}, {})
        for t, record in ended.last.items():
            self.fields["pressure", t].digits_lost = record.digits_lost
        fields = [self.fields[key] for key in sorted(self.fields, key=lambda key: (offered().index(key[0]), key[1]))]
        of_fields = worst([record.verdict for record in fields])
        effects = [of for of in self.effects if not self._inside(of)]
        missed = (self.chosen | {name for name, _ in self.unchecked}) - {record.field for record in fields}
        acting = self._acting(ended)
        if self.facts and self.facts.killing and failure and failure.died == "SIGSEGV":
            acting.append(record_of(finding(self.facts.killing), finding(self.facts.killing).effect))
        touching = [
            *ended.touching,
            *(of.finding for of in acting),
            *(of.finding for of in effects if of.field in missed),
        ]
        if touching:
            of_fields = worst([of_fields, "explained"])
        broke, lost = self.broke, ended.lost
        gone = lost is not None and not lost.ignored
        if (broke is not None or gone) and not failure:
            of_fields = worst([of_fields, "error"])
        if broke or failure or gone:
            fields = [self._until(record, bool(failure)) for record in fields]
        facts = self.facts or NOTHING
        explained = [*touching, *(name for record in fields for name in record.explained_by)]
        case = CaseRecord(
            case=name,
            tags=["audit"],
            about="your input deck, run unmodified",
            verdict=worst([of_fields, failure.verdict]) if failure else of_fields,
            ended=failure.verdict if failure else "answered",
            engine_error=failure.message if failure else "",
            died=failure.died if failure else "",
            blame=self.blame,
            natoms=sum(self._natoms().values()) or facts.natoms,
            steps=self.done,
            dimension=facts.dimension or None,
            units=facts.units or None,
            fields=fields,
            laws=facts.laws,
            warnings=ended.warnings,
            brief=ended.brief,
            stability=ended.stability,
            effects=effects,
            acting=acting,
            broke=broke,
            lost=lost,
            outlook=ended.outlook,
            budgets=self.budgets,
            series=ended.series,
            closed=ended.closed,
            checks=self.checks,
            thermo=ended.thermo,
            explained_by=list(dict.fromkeys(explained)),
            seconds=ended.seconds,
        )
        leave_unchecked(case, self.reasons())
        case.out_of_scope = out_of_scope(self.unchecked)
        case.message = case_wording.message(case) or (deck_wording.broke_at_length(broke) if broke else "")
        return case

    def _acting(self, ended: DeckEnd) -> list[ActingRecord]:
        """Return the findings that act by the deck's definitions, with the fields they leave open, and all others."""
        found = {of.finding: of for of in ended.acting}
        for field_, names in self.unpredictable:
            for name in names:
                of = found.get(name) or record_of(finding(name), finding(name).effect)
                found[name] = of.model_copy(update={"fields": [*dict.fromkeys([*of.fields, field_])]})
        return list(found.values())

    def _until(self, record: FieldRecord, ended: bool) -> FieldRecord:
        """Return a record with the last step at which the field was judged, of all atoms, before the state broke.

        Without a step if it is the last one, unless LAMMPS has ended the run.
        """
        looks = [c for c in self.checks if (c.field, c.type) == (record.field, record.atom_type or 0)]
        end = (self.broke.run, self.broke.step) if self.broke else self.sampled
        whole = [(c.run, c.step) for c in looks if c.natoms >= looks[0].natoms and (c.run, c.step) <= end]
        last = whole[-1] if whole else (looks[0].run, looks[0].step)
        return record.model_copy(update={"until": last[1]}) if ended or last < self.sampled else record

    def _inside(self, of: EffectRecord) -> bool:
        """Return whether the field was compared and within its bound, so that the effect is absent."""
        sample = of.run, of.step, of.field
        verdicts = [check.verdict for check in self.checks if (check.run, check.step, check.field) == sample]
        return bool(verdicts) and worst(verdicts) in wording.INSIDE

    def _natoms(self) -> dict[int, int]:
        """Return the atoms of the last sample by type; of all types together (0), if no field was compared by type."""
        last = self.checks[-1] if self.checks else None
        natoms = {
            check.type: check.natoms
            for check in self.checks[-64:]
            if last is not None and (check.step, check.run) == (last.step, last.run)
        }
        return {t: n for t, n in natoms.items() if t} or natoms


NEVER_COMPARABLE = (
    "no sample had an atom to compare: all lie next to reconstructed walls whose densities LAMMPS does not show "
    "as it used them, at the cutoff of others, or off the plane of a 2D deck"
)
NOTHING = RunFacts(0, 0, "", [], [])


def _joined(a: FieldRecord, b: FieldRecord) -> FieldRecord:
    """Return the earlier sample with the worst ratio, with the worst verdict and difference of both."""
    record = b if (b.max_over_bound or 0) > (a.max_over_bound or 0) else a
    verdict, max_abs = worst([a.verdict, b.verdict]), max(a.max_abs or 0.0, b.max_abs or 0.0)
    explained = list(dict.fromkeys([*a.explained_by, *b.explained_by])) if verdict == "explained" else []
    return record.model_copy(update={"verdict": verdict, "max_abs": max_abs, "explained_by": explained})


def _blame(sample: SampleRows, key: tuple[str, int], row: SampleRow) -> Blame:
    name, t = key
    assert row.first_id is not None
    return Blame(
        field=name,
        step=sample.step,
        run=sample.run,
        type=t or None,
        atom=row.first_id,
        outside=row.outside,
        of=row.natoms,
        max_abs=row.max_abs,
        max_over_bound=row.max_over_bound,
        worst_id=row.worst_id,
    )


def by_field(reasons: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Return all reasons of each field."""
    of_fields: dict[str, list[str]] = {}
    for name, reason in reasons:
        of_fields.setdefault(name, []).append(reason)
    return {name: "; ".join(of_field) for name, of_field in of_fields.items()}
