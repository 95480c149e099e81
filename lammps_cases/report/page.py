"""``report.html``: one page that opens offline, with everything inside, and the data from which it draws each case."""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import jinja2
import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from eos_ref.eos.table import FloatArray
from lammps_cases.claims import verdicts
from lammps_cases.comparison.compare import excess, worst_component
from lammps_cases.records import case_wording, deck_wording, wording
from lammps_cases.records.case_parts import CheckRecord, FieldRecord, StepRecord
from lammps_cases.records.faults import MissingPart, part
from lammps_cases.records.levels import SEVERITIES
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.report import findings, plots
from lammps_cases.report.findings import Outcome
from lammps_cases.report.history import Past
from lammps_cases.report.history.views import RunMark
from lammps_cases.report.pages import frame
from lammps_cases.report.pages.frame import packed, packed_once
from lammps_cases.report.statements import SUBJECTS, statements
from lammps_cases.scene.changes import catalogue
from lammps_cases.verdict.case_arrays import SIDES, read

ASSETS = Path(__file__).parent / "assets"
HISTORY_CSS = Path(__file__).parent / "history" / "assets" / "history.css"
ROWS = 200  # checks of an audit listed per case
LISTED = 1000  # cases listed on the page: a browser opens twice as many in two seconds
PICTURES = "pictures"  # name of a missing part of cases
WHOLE = 100  # cases of a run up to which all fields are drawn at all steps


@dataclass(frozen=True)
class WorstAtom:
    """Exact numbers of the worst atom of a field."""

    field: str
    values: dict[str, str]


@dataclass(frozen=True)
class Drawn:
    """The data from which the page draws a case, as JSON; the fields in it; exact numbers of worst atoms.

    ``more``: the other steps of all fields except the one in which a difference enters, whose steps are in the data.
    """

    data: Markup | None = None
    more: Markup | None = None
    fields: tuple[str, ...] = ()
    worst: tuple[WorstAtom, ...] = ()


def plot_data(case: CaseRecord, arrays: plots.Arrays, further: plots.Arrays = MappingProxyType({})) -> Drawn:
    """Return the data drawn from the arrays of a case, which may be empty, and from its file ``CASE@page.npz``."""
    # A case without fields was not compared in this run: a file of its name is left from an earlier one.
    at_hand = bool(case.fields) and "id" in arrays and bool(arrays["id"].size)
    reduced = one_per_atom({name: np.asarray(arrays[name]) for name in sorted(arrays)}) if at_hand else None
    differences = {} if reduced is None else plots.differences(reduced)
    data, more = plots.payload(case, reduced, differences, further)
    fields = tuple((data or {}).get("fields", ()))
    # For the model only the field in which a difference enters: it has a dozen.
    stepped = any(record.steps for record in case.fields)
    if stepped:
        exact_numbers = [name for name in fields if name == (data or {})["first"]]
    else:
        exact_numbers = [name for name, (difference_n, _) in differences.items() if difference_n.any()]
    return Drawn(
        None if data is None else embedded(data),
        embedded(more) if more else None,
        fields,
        tuple(_worst(case, reduced, name, *differences[name]) for name in exact_numbers) if reduced else (),
    )


def plot_data_of(case: CaseRecord, fields: Path, every_step: bool = True) -> Drawn:
    """Return the data shown of a case's arrays in the folder ``fields``, at the worst step of a field or at all."""
    own, further = read(fields, case.case) if case.fields else ({}, {})
    shown = further if every_step else {name: values for name, values in further.items() if name.startswith("@pairs ")}
    return plot_data(case, own, shown)


def one_per_atom(arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Reduce compared vectors and tensors, shape (n, ...), to their component closest to its bound, shape (n,)."""
    reduced = dict(arrays)
    for name in arrays:
        field, _, side = name.rpartition(".")
        sides = [f"{field}.{of}" for of in SIDES]
        if side != "lammps" or arrays[name].ndim == 1 or not all(of in arrays for of in sides):
            continue
        lammps_n, reference_n, bound_n = (np.asarray(arrays[of], float) for of in sides)
        ratio_n = excess(lammps_n, reference_n, bound_n)[1]
        for of, values_n in zip(sides, (lammps_n, reference_n, bound_n), strict=True):
            reduced[of] = worst_component(values_n, ratio_n)
    return reduced


def embedded(data: Any) -> Markup:
    """Return JSON that cannot close its script element, nor open a comment there."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def _worst(
    case: CaseRecord, arrays: plots.Arrays, field: str, difference_n: FloatArray, ratio_n: FloatArray
) -> WorstAtom:
    at = int(np.argmax(ratio_n))
    names = ("id", "type", "rho", "e", f"{field}.lammps", f"{field}.reference", f"{field}.bound")
    values = {name.removeprefix(f"{field}."): repr(arrays[name][at].item()) for name in names if name in arrays}
    values |= {"difference": repr(difference_n[at].item()), "difference/bound": repr(ratio_n[at].item())}
    delta_n = plots.offsets(case, arrays["type"][at : at + 1], np.asarray(arrays["rho"][at : at + 1], float))
    values |= {"(rho - rho0)/rho0": repr(delta_n[0].item())}
    values["position"] = ", ".join(repr(float(c)) for c in arrays["x"][at])
    return WorstAtom(field, values)


@dataclass(frozen=True)
class SteppedField:
    """A field at all steps that a case compares; ``span`` rows from this one on are of its stage."""

    record: FieldRecord
    span: int
    cells: list[StepRecord | None]
    drawn: bool


@dataclass(frozen=True)
class CaseEntry:
    """A case listed on the page."""

    record: CaseRecord
    accepted: bool

    @property
    def weight(self) -> int:
        """Return the approximate cost of its article: particles drawn, at every step of every field."""
        return 100 + min(self.record.natoms, plots.ATOMS) * sum(1 + len(field.steps) for field in self.record.fields)


@dataclass(frozen=True)
class CaseArticle:
    """A case as shown in its article."""

    record: CaseRecord
    accepted: bool
    drawn: Drawn
    checks: list[CheckRecord]
    steps: list[int]
    rows: list[SteppedField]


@dataclass(frozen=True)
class Family:
    """Cases with the same first part of their names, and much else in common: their articles are packed together.

    Attributes
    ----------
    fields : the folder of their arrays
    marks : the results of cases by version, for those with a history
    known : the findings of the ledger
    whole : whether all steps of all fields are drawn
    """

    entries: list[CaseEntry]
    fields: Path
    marks: Mapping[str, tuple[RunMark, ...]]
    known: frozenset[str]
    whole: bool

    @property
    def names(self) -> list[str]:
        """Return the names of the cases."""
        return [entry.record.case for entry in self.entries]


FamilyArticles = tuple[Markup, list[MissingPart]]  # packed, empty without articles; and what cases lack
Articles = Callable[[], list[FamilyArticles]]  # of every family, to be waited for
Making = Callable[[Sequence[Family]], Articles]  # starts making them


def articles(families: Sequence[Family]) -> list[FamilyArticles]:
    """Return the packed articles of every family."""
    environment = frame.environment_of(ASSETS)
    environment.filters |= FILTERS
    return [_articles(family, environment.get_template("articles.html.j2")) for family in families]


def _articles(family: Family, template: jinja2.Template) -> FamilyArticles:
    faults: list[MissingPart] = []

    def article(entry: CaseEntry) -> CaseArticle:
        bare = CaseArticle(entry.record, entry.accepted, Drawn(), [], [], [])
        return part(PICTURES, faults, lambda: _article(entry, family), bare, [entry.record.case])

    def text() -> Markup:
        made = template.render(
            entries=[article(entry) for entry in family.entries],
            marks=family.marks,
            known=family.known,
            wording=wording,
            case_wording=case_wording,
            deck_wording=deck_wording,
            statements_of=statements,
            subjects=SUBJECTS,
            changes=catalogue(),
        )
        return packed(made)

    return part(PICTURES, faults, text, Markup(), family.names), faults


def here(families: Sequence[Family]) -> Articles:
    """Make articles in this process, when they are waited for."""
    return lambda: articles(families)


class RunPage:
    """The page of a run, whose arrays lie in the folder ``fields``.

    ``making`` starts making the articles of cases at once, if it uses other processes.
    """

    def __init__(
        self,
        of_run: Outcome,
        fields: Path,
        history: Past | None = None,
        making: Making = here,
    ) -> None:
        self.of_run, self.history = of_run, history
        run = of_run.run
        self.matrices = part("agreement", run.faults, lambda: findings.matrices(run), [])
        self.claims = part("claims", run.faults, lambda: verdicts.summary(run), None)
        cases = listed(of_run, _named(self.matrices, self.claims))
        self.entries = [CaseEntry(case, of_run.accepted(case)) for case in cases]
        self.families = list(self._families(fields))
        self._articles = making(self.families)

    def render(self) -> str:
        """Return the page."""
        of_run, run = self.of_run, self.of_run.run
        made = self._articles()
        lacking = [fault for _, of_family in made for fault in of_family]
        run.faults[:] = [fault for fault in run.faults if fault.part != PICTURES]
        if lacking:
            cases = sorted({case for fault in lacking for case in fault.cases})
            run.faults.append(lacking[0].model_copy(update={"cases": cases}))
        plotly = (ASSETS / "plotly.min.js").read_text(encoding="utf-8")
        tags = Counter(tag for case in run.cases for tag in set(case.tags))
        return frame.page(
            ASSETS,
            "report",
            of_run.headline.look.css,
            engine=run.engine.label,
            date=run.date,
            filters=FILTERS,
            styles=[HISTORY_CSS] if self.history else [],
            scripts=[frame.PACKED, ASSETS / "plots.js"],
            unpacked=[plotly],
            plotly=packed_once(plotly),
            run=run,
            of_run=of_run,
            wording=wording,
            case_wording=case_wording,
            entries=self.entries,
            names={entry.record.case for entry in self.entries},
            families=self.families,
            articles=[text for text, _ in made],
            tags={tag: tags[tag] for tag in sorted(tags)},
            matrices=self.matrices,
            findings=of_run.findings,
            known=self._known,
            claims=self.claims,
            provenance=dict(_provenance(run)),
            seeds={entry.record.case: entry.record.seed for entry in self.entries if entry.record.seed is not None},
            history=self.history,
        )

    @property
    def _known(self) -> frozenset[str]:
        return frozenset(finding.entry.id for finding in self.of_run.findings)

    def _families(self, fields: Path) -> Iterator[Family]:
        by_name: dict[str, list[CaseEntry]] = {}
        for entry in self.entries:
            by_name.setdefault(entry.record.case.partition(".")[0], []).append(entry)
        marks = self.history.marks if self.history else {}
        whole = len(self.of_run.run.cases) <= WHOLE
        for entries in by_name.values():
            names = [entry.record.case for entry in entries]
            of_them = {name: marks[name] for name in names if len(marks.get(name, ())) > 1}
            yield Family(entries, fields, of_them, self._known, whole)


def render(of_run: Outcome, fields: Path, history: Past | None = None) -> str:
    """Return the page of a run, made by `RunPage` in one process."""
    return RunPage(of_run, fields, history).render()


def listed(of_run: Outcome, named: Collection[str] = ()) -> list[CaseRecord]:
    """Return the cases that the page lists, as many as it can: not accepted ones, named ones, others evenly by name."""
    cases = of_run.run.cases
    if len(cases) <= LISTED:
        return cases
    first = {case.case for case in [*of_run.unaccepted, *(case for case in cases if case.case in named)][:LISTED]}
    others = [case.case for case in cases if case.case not in first]
    room = LISTED - len(first)
    first |= {others[k * len(others) // room] for k in range(room)}
    return [case for case in cases if case.case in first]


def _named(matrices: Sequence[findings.Matrix], claims: verdicts.Summary | None) -> set[str]:
    """Return the cases that the tables of the page link to."""
    cells = [cell for matrix in matrices for row in matrix.rows for cell in row.cells if cell is not None]
    worst = {extreme.case for cell in cells for extreme in (cell.inside, cell.explained, cell.outside)}
    return worst | {judged.evidence[0].case for judged in (claims.refuted if claims else ())}


def shade(ratio: float | None, verdict: str) -> int:
    """Return the depth of a colour, 0 to 9 on a log scale: within the bound to 4, beyond it from 4 to 1e15 times it."""
    if ratio is None or ratio == 0:
        return 0
    decades = math.log10(ratio) if 0 < ratio < math.inf else math.inf
    if verdict in wording.INSIDE:
        return max(0, min(4, 4 + math.floor(decades)))
    return max(4, min(9, 4 + math.floor(min(decades, 15.0) / 3)))


def _rows(case: CaseRecord, steps: list[int], drawn: Collection[str]) -> list[SteppedField]:
    rows = []
    for _, of_stage in itertools.groupby(case.fields, key=lambda record: record.stage):
        records = list(of_stage)
        for i, record in enumerate(records):
            by_step = {at.step: at for at in record.steps}
            cells = [by_step.get(step) for step in steps]
            rows.append(SteppedField(record, len(records) if i == 0 else 0, cells, record.field in drawn))
    return rows


def _article(entry: CaseEntry, family: Family) -> CaseArticle:
    case, drawn = entry.record, plot_data_of(entry.record, family.fields, family.whole or not entry.accepted)
    steps = sorted({at.step for record in case.fields for at in record.steps})
    return CaseArticle(
        record=case,
        accepted=entry.accepted,
        drawn=drawn,
        checks=[case.checks[i] for i in plots.thinned_checks(case.checks, ROWS)],
        steps=steps,
        rows=_rows(case, steps, drawn.fields) if steps else [],
    )


def _provenance(run: RunRecord) -> Iterator[tuple[str, str]]:
    yield "command", run.command
    yield "date", run.date
    yield "wall time", f"{run.seconds:.2f} s"
    if run.predictions.stored:
        yield (
            "predictions",
            f"{wording.predictions(run.predictions)}, bit-identical to computed ones (--fresh recomputes them)",
        )
    of_severity = f"those that are {run.fail_on} or worse" if run.fail_on in SEVERITIES else f"above {run.fail_on}"
    yield "known findings that fail", "none" if run.fail_on == "new" else of_severity
    if run.allowed:
        yield "findings that are allowed", ", ".join(f"{name} ({why})" for name, why in run.allowed.items())
    for about in ("engine", "reference", "machine"):
        values = getattr(run, about)
        for name, value in (values if isinstance(values, dict) else values.model_dump()).items():
            if value:
                yield f"{about}: {name.replace('_', ' ')}", str(value)
    yield "record", run.schema_


def _sortable(value: float | None) -> str:
    """Return a number in the form in which the page's script sorts it: NaN comes last."""
    return "" if value is None else repr(float(value)).replace("inf", "Infinity").replace("nan", "Infinity")


FILTERS: Mapping[str, Callable[..., object]] = {"shade": shade, "sortable": _sortable}
