"""Sentences on a case: every end and every blame, from facts; no module parses one."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from syrupy.assertion import SnapshotAssertion

import eos_ref
import lammps_cases
from lammps_cases.records import case_wording
from lammps_cases.records.case_parts import Beyond, Blame, FieldRecord, HarnessError, LostAtoms, Mismatch, OtherSteps
from lammps_cases.records.run_record import CaseRecord

FORCE: dict[str, Any] = {"field": "f", "stage": "pair", "atom": 3, "outside": 2, "of": 9}
FORCE |= {"lammps": 1.5, "reference": 0.1, "bound": 1.234567e-15}
STEP = Blame(step=4, **FORCE)
LAW = Blame(type=2, rho=1.25, **FORCE | {"field": "pressure", "stage": "eos", "lammps": math.nan})
OF_TWIN = {"twin": "boost", "blame": Blame(step=4, **FORCE | {"stage": "twin"})}
AUDIT = Blame(field="f", step=10, run=2, atom=17, outside=1, of=75, max_abs=1e-9, max_over_bound=1234.5, worst_id=18)
BEYOND = Beyond(findings=["a", "b"], blame=STEP)
SEGV = {"ended": "crashed", "engine_error": "LAMMPS' process was killed by SIGSEGV: cannot touch (src/RHEO/x.cpp:1)"}
REFUSED = {
    "ended": "refused",
    "engine_error": "ERROR: Illegal fix command (src/RHEO/fix.cpp:9) Last input line: fix 1 all rheo",
}


def force(verdict: str, *findings: str) -> dict[str, Any]:
    field = {"field": "f", "stage": "pair", "verdict": verdict, "explained_by": list(findings)}
    return {"verdict": verdict, "fields": [FieldRecord.model_validate(field)]}


DIFFERS, EXPLAINED = force("differs"), {"verdict": "explained", "explained_by": ["a"]}
CASES: dict[str, dict[str, Any]] = {
    "agrees": force("pass"),
    "law": DIFFERS | {"blame": LAW},
    "step": DIFFERS | {"blame": STEP},
    "explained": force("explained", "a-b", "c") | {"blame": STEP},
    "beyond": DIFFERS | {"blame": STEP, "beyond": BEYOND},
    "twin": force("explained", "a") | OF_TWIN,
    "twin, and beyond": DIFFERS | OF_TWIN | {"beyond": BEYOND},
    "twin of another problem": DIFFERS | OF_TWIN | {"not_same_problem": True},
    "audit": DIFFERS | {"verdict": "refused", "ended": "refused", "engine_error": "ERROR: no", "blame": AUDIT},
    "audit of a type": DIFFERS | {"blame": AUDIT.model_copy(update={"type": 2})},
    "lost atoms": {
        "verdict": "differs",
        "ended": "unusable",
        "unusable": LostAtoms(returned=7, given=9, first_id=4),
    },
    "other steps": {"verdict": "differs", "ended": "unusable", "unusable": OtherSteps(counted=[0], asked=[0, 1])},
    "accepted": {"verdict": "differs", "ended": "accepted", "expects": "no's"},
    "accepted, explained": EXPLAINED | {"ended": "accepted", "expects": "no"},
    "refused": {"verdict": "refused"} | REFUSED,
    "refused as expected": {"verdict": "refused", "expects": "Illegal"} | REFUSED,
    "refused in other words": {"verdict": "differs", "expects": "no"} | REFUSED,
    "refused in other words, explained": EXPLAINED | {"expects": "no"} | REFUSED,
    "crashed, explained": EXPLAINED | SEGV,
    "timeout": {"verdict": "timeout", "ended": "timeout", "engine_error": "LAMMPS did not finish"},
    "twin alone": {"verdict": "crashed", "twin": "newton", "only_twin": True} | SEGV,
    "fault of the harness": {
        "verdict": "error",
        "ended": "error",
        "harness_error": HarnessError(exception="KeyError", text="'x'"),
    },
    "judge that died": {"verdict": "error", "ended": "error", "harness_error": HarnessError(text="killed")},
    "fault of a worker": {"verdict": "error", "ended": "error", "engine_error": "TypeError: x"},
    "lacks a keyword": {"verdict": "skipped", "ended": "skipped", "lacks": "cubic"},
    "of an older version": {"verdict": "differs", "message": "of old"},
}
CASES |= {
    f"field without a bound, beyond {findings}": DIFFERS
    | {
        "beyond": Beyond(
            findings=findings, blame=STEP.model_copy(update={"bound": math.inf, "lammps": 0.0, "reference": 0.0})
        )
    }
    for findings in ([], ["a"])
}
CASES |= {
    f"probe: {facts['kind']}": {"verdict": "differs", "mismatch": Mismatch(**facts)}
    for facts in (
        {"kind": "not finite", "fields": ["p", "f"]},
        {"kind": "logged", "text": "WARNING"},
        {"kind": "blind", "text": "no difference"},
        {"kind": "other atoms", "fields": ["p"], "counts": [1, 2]},
        {"kind": "other numbers", "fields": ["p"], "counts": [1, 2], "values": [4.0, 4.5]},
        {"kind": "measured", "fields": ["p"], "values": [4.0, 4.5, 0.125]},
    )
}


def test_every_end_and_blame_has_a_sentence(snapshot: SnapshotAssertion) -> None:
    """Whole, without the findings next to it, and LAMMPS' own words in brief, where they are others."""
    said: dict[str, list[str]] = {}
    for name, facts in CASES.items():
        case = CaseRecord(case="one", **facts)
        whole = case_wording.message(case)
        said[name] = list(
            dict.fromkeys([whole, case_wording.message(case, findings=False), case_wording.own_words(case)])
        )
    assert said == snapshot


# --- no sentence is parsed

PARSING = {"split", "rsplit", "partition", "rpartition", "startswith", "endswith", "removeprefix", "removesuffix"}
MATCHING = {"match", "fullmatch", "search", "sub", "findall", "finditer"}
# Attributes that hold one or several of our own sentences; also findings, which were one text once.
SENTENCE = {"message", "explained_by", "rule", "sentence", "headline", "complaint", "blame", "reason", "title", "why"}
SENTENCES_OF = {"not_checked", "warnings", "stability", "messages", "complaints", "rules"}


def _named(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def parsed(source: str) -> Iterator[int]:
    """Yield lines that split a sentence or findings, or search for words in them."""
    tree = ast.parse(source)
    loops = [node for node in ast.walk(tree) if isinstance(node, ast.For | ast.comprehension)]
    each_of_several = {_named(loop.target) for loop in loops if getattr(loop.iter, "attr", "") in SENTENCES_OF}
    sentences = SENTENCE | (each_of_several - {""})
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
            among = sentences - {"explained_by"} if words else {"message"}
            if any(_named(side) in among for side in node.comparators):
                yield node.lineno


PARSED = [
    'record.message.partition(",")',
    '(field.explained_by or "").split(", ")',
    're.search("stage", record.message)',
    '"ERROR" in message',
    "word in record.message",
    "case.message.removesuffix(end)",
    're.match(r"[a-z]+", rule)',
    '[line.partition(": ") for line in case.not_checked]',
]


@pytest.mark.slow
def test_no_message_and_no_name_of_a_field_is_parsed() -> None:
    """Of names of fields neither the suffix of input nor its opening bracket."""
    assert all(list(parsed(line)) == [1] for line in PARSED)
    sources = [path for of in (eos_ref, lammps_cases) for path in Path(of.__path__[0]).rglob("*.py")]
    texts = {path: path.read_text(encoding="utf-8") for path in sources}
    assert len(texts) > 200
    assert [(str(path), line) for path, text in texts.items() for line in parsed(text)] == []
    name = re.compile(r"""["'}] ?\(given\)|partition\(" \("|split\(" \(""")
    assert [path.name for path, text in texts.items() if name.search(text)] == ["wording.py"]
