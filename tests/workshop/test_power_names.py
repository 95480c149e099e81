"""What eos-ref power is told to plant is checked before a worker is started, and before anything kept is forgotten."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.cli import power
from tests.workshop.faults import catalogue, collect
from tests.workshop.faults.fault import FAMILIES, Detection
from tests.workshop.faults.record import ControlRecord, FaultRecord, Power
from tests.support.outcome import Outcome


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("falts", "faults"),
        ("told.cs-doubld", "told.cs-doubled"),
        ("tol.*", "told.*"),
        ("told.*xx", ""),
        ("what.is", ""),
    ],
)
def test_a_typo_is_refused_before_anything_starts_or_is_forgotten(
    name: str, meant: str, eos_ref_command: Callable[..., Outcome], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(collect, "MutationPool", None)
    kept = tmp_path / "planted.jsonl"
    kept.write_text("what other runs planted")
    done = eos_ref_command("power", "faults", name, "--fresh", "--out", tmp_path)
    assert done.code == 2 and f"no such section or fault: {name!r}" in done.err
    assert (f"did you mean {meant!r}?" in done.err) or not meant
    assert kept.exists()


@pytest.mark.parametrize(
    ("name", "families"), [("falts", ()), ("told.cs", ("told",)), ("read.*", ("read",)), ("*.cs", FAMILIES)]
)
def test_only_the_families_that_a_name_can_be_of_are_listed(
    name: str, families: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    listed: dict[str, None] = {}
    for family in FAMILIES:
        monkeypatch.setitem(catalogue.LISTED, family, lambda of=family: listed.setdefault(of) or {})
    with pytest.raises(InputError):
        catalogue.check([name])
    assert tuple(listed) == families


@pytest.mark.parametrize("whole", [False, True])
def test_only_what_was_planted_is_printed(whole: bool, capsys: pytest.CaptureFixture[str]) -> None:
    fault = FaultRecord(
        "told.x", "told", "constant", "x", ("case",), True, (Detection("case", "differs", "f", ""),), ""
    )
    controls = tuple(ControlRecord(family, 1, ()) for family in FAMILIES)
    measured = {"quick_only": False, "resolution": (), "alarms": (), "seconds": 1.0}
    found = Power("eos-ref power", {}, {}, whole=whole, controls=controls, faults=(fault,), **measured)
    power._show(found, Path("reports"))
    out = capsys.readouterr().out
    assert [line.split()[0] for line in out.splitlines()[:2]] == ["told", "1"]
    assert (found.statement in out) == whole
