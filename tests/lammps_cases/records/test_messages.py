"""Sentences on a case: every end and every blame, from facts."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import eos_ref
import lammps_cases
from eos_ref import InputError
from lammps_cases.records import case_wording
from lammps_cases.records.case_parts import Beyond, Blame, FieldRecord, HarnessError, LostAtoms, Mismatch, OtherSteps
from lammps_cases.records.run_record import CaseRecord, read_run

FORCE: dict[str, Any] = {"field": "f", "stage": "pair", "atom": 3, "outside": 2, "of": 9}
FORCE |= {"lammps": 1.5, "reference": 0.1, "bound": 1.234567e-15}
STEP = Blame(step=4, **FORCE)
LAW = Blame(type=2, rho=1.25, **FORCE | {"field": "pressure", "stage": "eos", "lammps": float("nan")})
TWIN = Blame(step=4, **FORCE | {"stage": "twin"})
AUDIT = Blame(field="f", step=10, run=2, atom=17, outside=1, of=75, max_abs=1e-9, max_over_bound=1234.5, worst_id=18)
NUMBERS = "2 of 9 atoms, first atom 3: LAMMPS 1.5, reference 0.1, bound 1.23e-15"
SEGV = "LAMMPS' process was killed by SIGSEGV: cannot touch (src/RHEO/x.cpp:1)"
WORDS = "ERROR: Illegal fix command (src/RHEO/fix.cpp:9) Last input line: fix 1 all rheo"


def force(verdict: str, *findings: str, **more: Any) -> list[FieldRecord]:
    return [
        FieldRecord.model_validate(
            {"field": "f", "stage": "pair", "verdict": verdict, "explained_by": findings, **more}
        )
    ]


# facts of a record, its message
SENTENCES: dict[str, tuple[dict[str, Any], str]] = {
    "agrees": ({"verdict": "pass", "fields": force("pass")}, ""),
    "law": (
        {"verdict": "differs", "blame": LAW, "fields": force("differs", field="pressure")},
        "pressure (stage eos) leaves its bound at 2 of 9 atoms, first atom 3 (type 2, rho 1.25): LAMMPS nan, "
        "reference 0.1, bound 1.23e-15",
    ),
    "step": (
        {"verdict": "differs", "blame": STEP, "fields": force("differs")},
        f"f (stage pair) leaves its bound at step 4 at {NUMBERS}",
    ),
    "explained": (
        {"verdict": "explained", "blame": STEP, "fields": force("explained", "a-b", "c")},
        f"f (stage pair) leaves its bound at step 4 at {NUMBERS}; explained by a-b, c",
    ),
    "beyond": (
        {
            "verdict": "differs",
            "blame": STEP,
            "beyond": Beyond(findings=["a", "b"], blame=STEP),
            "fields": force("differs"),
        },
        f"f (stage pair) leaves its bound at step 4 at {NUMBERS}, in addition to a, b",
    ),
    "twin": (
        {"verdict": "explained", "twin": "boost", "blame": TWIN, "fields": force("explained", "a")},
        "LAMMPS against itself (twin: boost): f (stage twin) leaves its bound at step 4 at 2 of 9 atoms, first atom 3: "
        "as given 1.5, as its boost twin 0.1, bound 1.23e-15; explained by a",
    ),
    "twin, and beyond": (
        {
            "verdict": "differs",
            "twin": "boost",
            "blame": TWIN,
            "beyond": Beyond(findings=["a", "b"], blame=STEP),
            "fields": force("differs"),
        },
        "LAMMPS against itself (twin: boost): f (stage twin) leaves its bound at step 4 at 2 of 9 atoms, first atom 3: "
        "as given 1.5, as its boost twin 0.1, bound 1.23e-15; of one run f (stage pair) leaves its bound at step 4 at "
        f"{NUMBERS}, in addition to a, b",
    ),
    "twin of another problem": (
        {"verdict": "differs", "twin": "boost", "blame": TWIN, "not_same_problem": True, "fields": force("differs")},
        "LAMMPS against itself (twin: boost): f (stage twin) leaves its bound at step 4 at 2 of 9 atoms, first atom 3: "
        "as given 1.5, as its boost twin 0.1, bound 1.23e-15; the reference differs as well, so the two are not the "
        "same problem",
    ),
    "audit": (
        {
            "verdict": "refused",
            "ended": "refused",
            "engine_error": "ERROR: no",
            "blame": AUDIT,
            "fields": force("differs"),
        },
        "f leaves its bound first at step 10 (run 2), atom 17: 1 of 75 atoms outside, |LAMMPS - reference| up to 1e-09 "
        "= 1.23e+03 x bound (atom 18); ERROR: no",
    ),
    "audit of a type": (
        {"verdict": "differs", "blame": AUDIT.model_copy(update={"type": 2}), "fields": force("differs")},
        "f leaves its bound first at step 10 (run 2), type 2, atom 17: 1 of 75 atoms outside, |LAMMPS - reference| up "
        "to 1e-09 = 1.23e+03 x bound (atom 18)",
    ),
    "lost atoms": (
        {"verdict": "differs", "ended": "unusable", "unusable": LostAtoms(returned=7, given=9, first_id=4)},
        "id (stage input): LAMMPS returned 7 of 9 atoms; first missing, foreign or doubled id: 4",
    ),
    "other steps": (
        {"verdict": "differs", "ended": "unusable", "unusable": OtherSteps(counted=[0], asked=[0, 1])},
        "LAMMPS counted steps (0,) instead of the requested (0, 1)",
    ),
    "accepted": (
        {"verdict": "differs", "ended": "accepted", "expects": "no's"},
        'LAMMPS accepts what the manual refuses; expected an error with "no\'s"',
    ),
    "accepted, explained": (
        {"verdict": "explained", "ended": "accepted", "expects": "no", "explained_by": ["a"]},
        "differs, as ledger entry a predicts: LAMMPS accepts what the manual refuses; expected an error with 'no'",
    ),
    "refused": ({"verdict": "refused", "ended": "refused", "engine_error": WORDS}, WORDS),
    "refused as expected": (
        {"verdict": "refused", "ended": "refused", "engine_error": WORDS, "expects": "Illegal"},
        WORDS,
    ),
    "refused in other words": (
        {"verdict": "differs", "ended": "refused", "engine_error": WORDS, "expects": "no"},
        f"expected an error with 'no', LAMMPS printed: {WORDS}",
    ),
    "refused in other words, explained": (
        {"verdict": "explained", "ended": "refused", "engine_error": WORDS, "expects": "no", "explained_by": ["a"]},
        f"differs, as ledger entry a predicts: expected an error with 'no', LAMMPS printed: {WORDS}",
    ),
    "crashed, explained": (
        {"verdict": "explained", "ended": "crashed", "engine_error": SEGV, "explained_by": ["a"]},
        f"crashed, as ledger entry a predicts: {SEGV}",
    ),
    "timeout": (
        {"verdict": "timeout", "ended": "timeout", "engine_error": "LAMMPS did not finish"},
        "LAMMPS did not finish",
    ),
    "twin alone": (
        {"verdict": "crashed", "ended": "crashed", "engine_error": SEGV, "twin": "newton", "only_twin": True},
        f"LAMMPS answers, and its twin (newton) does not: {SEGV}",
    ),
    "fault of the harness": (
        {"verdict": "error", "ended": "error", "harness_error": HarnessError(exception="KeyError", text="'x'")},
        "KeyError in the harness: 'x'",
    ),
    "judge that died": (
        {"verdict": "error", "ended": "error", "harness_error": HarnessError(text="killed")},
        "judging failed: killed",
    ),
    "fault of a worker": ({"verdict": "error", "ended": "error", "engine_error": "TypeError: x"}, "TypeError: x"),
}
PROBES: dict[str, tuple[dict[str, Any], str]] = {
    "not finite": ({"kind": "not finite", "fields": ["p", "f"]}, "p, f are NaN or infinite"),
    "logged": ({"kind": "logged", "text": "WARNING"}, "the log holds 'WARNING'"),
    "blind": ({"kind": "blind", "text": "no difference"}, "the probe is blind: its control passes (no difference)"),
    "other atoms": ({"kind": "other atoms", "fields": ["p"], "counts": [1, 2]}, "p differs: 1 and 2 atoms"),
    "other numbers": (
        {"kind": "other numbers", "fields": ["p"], "counts": [1, 2], "values": [4.0, 4.5]},
        "p differs at 1 of 2 numbers, most 4.0 and 4.5",
    ),
}


@pytest.mark.parametrize("name", SENTENCES)
def test_every_end_and_blame_has_a_sentence(name: str) -> None:
    facts, sentence = SENTENCES[name]
    assert case_wording.message(CaseRecord(case="one", **facts)) == sentence


@pytest.mark.parametrize("name", PROBES)
def test_every_mismatch_of_a_probe_has_a_sentence(name: str) -> None:
    facts, sentence = PROBES[name]
    assert case_wording.message(CaseRecord(case="probes.x", verdict="differs", mismatch=Mismatch(**facts))) == sentence


def test_findings_next_to_the_blame_may_be_omitted() -> None:
    record = CaseRecord(case="one", **SENTENCES["explained"][0])
    assert case_wording.message(record, findings=False) == f"f (stage pair) leaves its bound at step 4 at {NUMBERS}"


def test_a_record_without_facts_keeps_its_message() -> None:
    record = CaseRecord(case="one", verdict="differs", message="of old")
    assert case_wording.message(record) == case_wording.own_words(record) == "of old"


def test_own_words_are_brief_and_without_the_finding() -> None:
    of = {name: case_wording.own_words(CaseRecord(case="one", **facts)) for name, (facts, _) in SENTENCES.items()}
    assert of["refused"] == "ERROR: Illegal fix command"
    assert of["crashed, explained"] == "crashed: LAMMPS' process was killed by SIGSEGV: cannot touch"
    assert of["refused in other words, explained"] == (
        "differs: expected an error with 'no', LAMMPS printed: ERROR: Illegal fix command"
    )


@pytest.mark.parametrize("text", ["{", "[]", '{"schema": "eos-ref/run/3", "engine": {}, "reference": {}}'])
def test_other_schemas_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(InputError):
        read_run(tmp_path)


# --- no sentence is parsed


PARSING = {"split", "rsplit", "partition", "rpartition", "startswith", "endswith", "removeprefix", "removesuffix"}
MATCHING = {"match", "fullmatch", "search", "sub", "findall", "finditer"}
# Attributes that hold one or several of our own sentences; also findings, which were one text once.
SENTENCE = {"message", "explained_by", "rule", "sentence", "headline", "complaint", "blame", "reason", "title", "why"}
SENTENCES_OF = {"not_checked", "warnings", "stability", "messages", "complaints", "rules"}


def _named(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _each_of_several(tree: ast.AST) -> set[str]:
    """Names that stand for each of several sentences in turn."""
    loops = (node for node in ast.walk(tree) if isinstance(node, ast.For | ast.comprehension))
    several = (loop for loop in loops if isinstance(loop.iter, ast.Attribute) and loop.iter.attr in SENTENCES_OF)
    return {loop.target.id for loop in several if isinstance(loop.target, ast.Name)}


def parsed(source: str) -> Iterator[int]:
    """Yield lines that split a sentence or findings, or search for words in them."""
    tree = ast.parse(source)
    sentences = SENTENCE | _each_of_several(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            of = node.func.value
            texts = of.values if isinstance(of, ast.BoolOp) else [of]
            blanks = node.func.attr == "split" and not node.args  # and joined again
            if node.func.attr in PARSING and not blanks and any(_named(text) in sentences for text in texts):
                yield node.lineno
            if node.func.attr in MATCHING and any(_named(argument) in sentences for argument in node.args):
                yield node.lineno
        if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn):
            words = isinstance(node.left, ast.Constant | ast.JoinedStr)
            of = sentences - {"explained_by"} if words else {"message"}
            if any(_named(side) in of for side in node.comparators):
                yield node.lineno


@pytest.mark.parametrize(
    "line",
    [
        'record.message.partition(",")',
        '(field.explained_by or "").split(", ")',
        're.search("stage", record.message)',
        '"ERROR" in message',
        "word in record.message",
        "case.message.removesuffix(end)",
        'NUMBER.sub("#", error.rule)',
        're.match(r"[a-z]+", rule)',
        '"found" in rule',
        'page.title.removeprefix("PASS: ")',
        'of.why.partition("manual: ")',
        '[line.partition(": ") for line in case.not_checked]',
    ],
)
def test_parsing_is_detected(line: str) -> None:
    assert list(parsed(line)) == [1]


@pytest.mark.slow
def test_no_message_is_parsed() -> None:
    folders = [Path(package.__path__[0]) for package in (eos_ref, lammps_cases)]
    sources = [path for folder in folders for path in folder.rglob("*.py")]
    assert len(sources) > 200
    assert [(str(path), line) for path in sources for line in parsed(path.read_text(encoding="utf-8"))] == []


@pytest.mark.parametrize(("findings", "beside"), [([], ""), (["a"], ", in addition to a")])
def test_field_without_a_bound_is_not_predictable(findings: list[str], beside: str) -> None:
    blame = STEP.model_copy(update={"bound": math.inf, "lammps": 0.0, "reference": 0.0})
    said = case_wording.message(CaseRecord(case="x", verdict="differs", beyond=Beyond(findings=findings, blame=blame)))
    unknown = "f (stage pair) is not predictable at step 4 at 2 of 9 atoms, first atom 3"
    assert said == f"{unknown}; all that has a bound is inside{beside}"
