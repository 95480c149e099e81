"""From looks to the record of an audit."""

from __future__ import annotations

from dataclasses import dataclass, field

from lammps_cases.audit.options import Ended, Facts, Identity, Look, Place, Row
from lammps_cases.records import CaseRecord, CheckRecord, FieldRecord, Verdict, worst


@dataclass
class Findings:
    """What has arrived from the process that runs the deck, so far."""

    place: Place = field(default_factory=lambda: Place("", ""))
    who: dict[str, str] = field(default_factory=dict)
    facts: Facts | None = None
    done: int = 0
    checks: list[CheckRecord] = field(default_factory=list)
    fields: dict[int, FieldRecord] = field(default_factory=dict)
    blame: str = ""
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
            case Look():
                self._look(message)
            case Ended():
                self.ended = message
                self.done = message.done

    def _look(self, look: Look) -> None:
        self.done = look.done
        for t, row in look.rows.items():
            self.checks.append(_check(look, t, row))
            record = self._field(look, t, row)
            self.fields[t] = _joined(self.fields[t], record) if t in self.fields else record
            if row.verdict == "differs" and not self.blame:
                self.blame = _blame(look, t, row)

    def _field(self, look: Look, t: int, row: Row) -> FieldRecord:
        return FieldRecord(
            field="pressure",
            stage="eos",
            derivation=self.facts.derivations[t - 1] if self.facts else "",
            atom_type=t,
            worst_step=look.step,
            **{name: value for name, value in row._asdict().items() if name != "natoms"},
        )

    def case(self, name: str, verdict: Verdict = "skipped", message: str = "") -> CaseRecord:
        """The record; ``verdict`` and ``message`` say how LAMMPS ended, if not well."""
        if self.ended is not None:
            for t, record in self.ended.last.items():
                self.fields[t].digits_lost = record.digits_lost
        fields = [self.fields[t] for t in sorted(self.fields)]
        of_fields = worst([record.verdict for record in fields])
        facts = self.facts or Facts(0, 0, "", [], [])
        return CaseRecord(
            case=name,
            tags=["audit"],
            about="an input deck of the user, unchanged",
            verdict=worst([of_fields, verdict]),
            natoms=sum(self._natoms().values()) or facts.natoms,
            steps=self.done,
            dimension=facts.dimension or None,
            units=facts.units or None,
            fields=fields,
            message="; ".join(filter(None, (self.blame, message))),
            laws=facts.laws,
            warnings=self.ended.warnings if self.ended else [],
            checks=self.checks,
            **({"seconds": self.ended.seconds} if self.ended else {}),
        )

    def _natoms(self) -> dict[int, int]:
        last = self.checks[-1] if self.checks else None
        return {
            check.type: check.natoms
            for check in self.checks[-64:]
            if last is not None and (check.step, check.run) == (last.step, last.run)
        }


def _check(look: Look, t: int, row: Row) -> CheckRecord:
    return CheckRecord(
        step=look.step,
        run=look.run,
        type=t,
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
    return record.model_copy(update={"verdict": verdict, "max_abs": max_abs})


def _blame(look: Look, t: int, row: Row) -> str:
    return (
        f"pressure leaves its bound first at step {look.step} (run {look.run}), type {t}, atom {row.first_id}: "
        f"{row.outside} of {row.natoms} atoms outside, |LAMMPS - reference| up to {row.max_abs:.3g} = "
        f"{row.max_over_bound:.3g} x bound (atom {row.worst_id})"
    )
