"""NaN, infinity and subnormal numbers in every column of an audited dump: never PASS, never a traceback."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.audit import finished, supervise
from lammps_cases.audit.messages import DeckSetups
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.verdict import Findings
from lammps_cases.records.run_record import CaseRecord
from tests.support.audited_decks import DECKS, run_plain
from tests.support.outcome import Outcome

pytestmark = pytest.mark.lammps

COLUMNS = [
    *("id", "type", "x", "y", "z", "vx", "vy", "vz", "fx", "fy", "fz"),
    *("c_rates", "c_state[1]", "c_state[2]", "c_state[3]", "c_state[4]"),
]
INTEGERS = ("id", "type")
WATCH = f"""compute state all rheo/property/atom phase rho pressure grad/v/xx
compute rates all property/atom drho
dump all all custom 5 all.dump {" ".join(COLUMNS)}
dump_modify all format float %.17g
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A deck and its dump."""
    folder = tmp_path_factory.mktemp("dumped")
    lines = (DECKS / "in.power").read_text().splitlines(keepends=True)
    at = next(k for k, line in enumerate(lines) if line.startswith("run "))
    for path in DECKS.glob("*.inc"):
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "in.deck").write_text("".join([*lines[:at], WATCH, *lines[at:]]))
    run_plain("in.deck", folder)
    return folder


@pytest.fixture(autouse=True)
def described_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run LAMMPS once to describe the deck for all tests."""
    who, setups = describe(folder)
    monkeypatch.setattr(finished, "described", lambda *_: (Findings(who=who), setups))


@functools.cache
def describe(folder: Path) -> tuple[dict[str, str], DeckSetups]:
    findings, setups = supervise.described(folder / "in.deck", AuditOptions())
    return findings.who, setups


def edited(folder: Path, column: str, text: str, to: Path) -> tuple[Path, str, str]:
    """Put a number into a column of one atom of the last snapshot; return the dump, the step and the id."""
    lines = (folder / "all.dump").read_text().splitlines()
    starts = [k for k, line in enumerate(lines) if line.startswith("ITEM: TIMESTEP")]
    row = next(k for k, line in enumerate(lines) if k > starts[-1] and line.startswith("ITEM: ATOMS")) + 3
    words = lines[row].split()
    words[COLUMNS.index(column)] = text
    lines[row] = " ".join(words)
    dump = to / "all.dump"
    dump.write_text("\n".join(lines) + "\n")
    return dump, lines[starts[-1] + 1], words[0]


def audited(dump: Path, folder: Path) -> CaseRecord:
    return finished.audit_dump(dump, folder / "in.deck", AuditOptions()).record.cases[0]


@pytest.mark.parametrize("text", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("column", COLUMNS)
def test_non_finite_number_never_passes(
    column: str, text: str, folder: Path, tmp_path: Path, eos_ref_command: Callable[..., Outcome]
) -> None:
    dump, step, atom = edited(folder, column, text, tmp_path)
    words = ("audit", folder / "in.deck", "--dump", dump, "--out", tmp_path / "out")
    code, out, err = eos_ref_command(*words)
    assert "PASS" not in out and code != 0
    if column in INTEGERS:
        assert code == 2 and column in err and text in err and err.count("\n") == 1
    else:  # named with step, particle and column
        assert all(word in out for word in (step, atom, column)), out


@pytest.mark.parametrize("text", ["5e-324", "1e-310"])
@pytest.mark.parametrize("column", [name for name in COLUMNS if name not in INTEGERS])
def test_subnormal_number_is_compared(column: str, text: str, folder: Path, tmp_path: Path) -> None:
    dump, _, _ = edited(folder, column, text, tmp_path)
    try:
        case = audited(dump, folder)
    except InputError as error:
        pytest.fail(str(error))
    as_zero, _, _ = edited(folder, column, "0", tmp_path)
    assert [(field.field, field.verdict) for field in case.fields] == [
        (field.field, field.verdict) for field in audited(as_zero, folder).fields
    ]
