"""From looks to the record of an audit."""

from __future__ import annotations

from dataclasses import dataclass, field

from lammps_cases.audit.fields import offered
from lammps_cases.audit.options import Ended, Facts, Identity, Look, Place, Row
from lammps_cases.engine.workers import Failure
from lammps_cases.records import wording
from lammps_cases.records.run_record import Blame, CaseRecord, CheckRecord, FieldRecord, worst


@dataclass
class Findings:
    """What has arrived from the process that runs the deck, so far."""

    place: Place = field(default_factory=lambda: Place("", ""))
    who: dict[str, str] = field(default_factory=dict)
    facts: Facts | None = None
    done: int = 0
    checks: list[CheckRecord] = field(default_factory=list)
    fields: dict[tuple[str, int], FieldRecord] = field(default_factory=dict)
    unchecked: dict[tuple[str, str], list[int]] = field(default_factory=dict)  # runs by field and reason
    chosen: set[str] = field(default_factory=set)
    blame: Blame | None = None
    ended: Ended | None = None

    def take(self, message: object) -> None:
        """Take one message."""
        match message:
            case Place():
                self.place = message
            case Identity():
                self.who = message.who
            case Facts():
                self.facts = message
                self.chosen |= message.stages.keys()
                for reason in message.unchecked.items():
                    self.unchecked.setdefault(reason, []).append(message.run)
            case Look():
                self._look(message)
            case Ended():
                self.ended = message
                self.done = message.done

    def _look(self, look: Look) -> None:
        self.done = look.done
        for key, row in look.rows.items():
            self.checks.append(_check(look, key, row))
            record = self._field(look, key, row)
            self.fields[key] = _joined(self.fields[key], record) if key in self.fields else record
            if row.verdict == "differs" and self.blame is None:
                self.blame = _blame(look, key, row)

    def _field(self, look: Look, key: tuple[str, int], row: Row) -> FieldRecord:
        name, t = key
        facts = self.facts or NOTHING
        return FieldRecord(
            field=name,
            stage=facts.stages.get(name, "eos"),
            derivation=facts.derivations[t - 1] if t and facts.derivations else facts.derivation,
            atom_type=t or None,
            worst_step=look.step,
            **{name: value for name, value in row._asdict().items() if name != "natoms"},
        )

    def _unchecked(self) -> list[str]:
        """A line per field and reason, with the runs if it was checked, or not for another reason, in others."""
        several = len({run for runs in self.unchecked.values() for run in runs} | {c.run for c in self.checks}) > 1
        seen = {name for name, _ in self.fields}
        missed = [name for name in offered() if name in self.chosen - seen and self.checks]
        return [
            f"{name}: {reason}" + (f" (run {', '.join(map(str, runs))})" if several else "")
            for (name, reason), runs in self.unchecked.items()
        ] + [f"{name}: {UNTOLD}" for name in missed]

    def case(self, name: str, failure: Failure | None = None) -> CaseRecord:
        """Make the record; ``failure`` says how LAMMPS ended, if not well."""
        if self.ended is not None:
            for t, record in self.ended.last.items():
                self.fields["pressure", t].digits_lost = record.digits_lost
        fields = [self.fields[key] for key in sorted(self.fields, key=lambda key: (offered().index(key[0]), key[1]))]
        of_fields = worst([record.verdict for record in fields])
        facts = self.facts or NOTHING
        explained = [name for record in fields for name in record.explained_by]
        case = CaseRecord(
            case=name,
            tags=["audit"],
            about="an input deck of the user, unchanged",
            verdict=worst([of_fields, failure.verdict]) if failure else of_fields,
            ended=failure.verdict if failure else "answered",
            engine_error=failure.message if failure else "",
            blame=self.blame,
            natoms=sum(self._natoms().values()) or facts.natoms,
            steps=self.done,
            dimension=facts.dimension or None,
            units=facts.units or None,
            fields=fields,
            laws=facts.laws,
            warnings=self.ended.warnings if self.ended else [],
            stability=self.ended.stability if self.ended else [],
            checks=self.checks,
            not_checked=self._unchecked(),
            explained_by=list(dict.fromkeys(explained)),
            **({"seconds": self.ended.seconds} if self.ended else {}),
        )
        case.message = wording.message(case)
        return case

    def _natoms(self) -> dict[int, int]:
        """Atoms of the last look, by type; of all types together (0), if no field was looked at by type."""
        last = self.checks[-1] if self.checks else None
        found = {
            check.type: check.natoms
            for check in self.checks[-64:]
            if last is not None and (check.step, check.run) == (last.step, last.run)
        }
        return {t: n for t, n in found.items() if t} or found


UNTOLD = (
    "no look could tell it of any atom: all lie beside reconstructed walls whose densities LAMMPS does not show as it "
    "used them, at the cutoff of others, or off the plane of a 2D deck"
)
NOTHING = Facts(0, 0, "", [], [])


def _check(look: Look, key: tuple[str, int], row: Row) -> CheckRecord:
    return CheckRecord(
        step=look.step,
        run=look.run,
        field=key[0],
        type=key[1],
        natoms=row.natoms,
        verdict=row.verdict,
        max_abs=row.max_abs,
        max_over_bound=row.max_over_bound,
        worst_id=row.worst_id,
    )


def _joined(a: FieldRecord, b: FieldRecord) -> FieldRecord:
    """The earlier look with the worst ratio, with the worst verdict and difference of both."""
    record = b if (b.max_over_bound or 0) > (a.max_over_bound or 0) else a
    verdict, max_abs = worst([a.verdict, b.verdict]), max(a.max_abs or 0.0, b.max_abs or 0.0)
    explained = list(dict.fromkeys([*a.explained_by, *b.explained_by])) if verdict == "explained" else []
    return record.model_copy(update={"verdict": verdict, "max_abs": max_abs, "explained_by": explained})


def _blame(look: Look, key: tuple[str, int], row: Row) -> Blame:
    name, t = key
    assert row.first_id is not None
    return Blame(
        field=name,
        step=look.step,
        run=look.run,
        type=t or None,
        atom=row.first_id,
        outside=row.outside,
        of=row.natoms,
        max_abs=row.max_abs,
        max_over_bound=row.max_over_bound,
        worst_id=row.worst_id,
    )
