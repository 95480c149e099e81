"""A deck as a regression test: baselines, what counts as a change, folders of decks, and eos-ref.toml."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.audit import command
from lammps_cases.audit.options import AuditOptions
from lammps_cases.records.run_record import read_run
from lammps_cases.versions import baseline, outcomes
from lammps_cases.versions.outcomes import Sample, read
from tests.support.audited_decks import FIXES, write_deck
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
REPORT = Path("reports") / "audit-in.deck"
COMMANDS = f"set group all rheo/rho 1.1\n{FIXES}fix 3 all rheo/pressure * cubic 0.5\nthermo 10\nrun 20\n"
OTHER = "pypi:2025.7.22.1.0"  # without the finding force-per-volume


@pytest.fixture
def deck(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_deck(tmp_path, COMMANDS)
    return Path("in.deck")


def edit(deck: Path, old: str, new: str) -> None:
    text = deck.read_text()
    assert old in text
    deck.write_text(text.replace(old, new))


# --- baselines


@pytest.mark.lammps
@pytest.mark.slow
def test_change_is_reported_with_step_field_and_atom(deck: Path, eos_ref_command: Run) -> None:
    code, said, _ = eos_ref_command("audit", deck, "--accept", "--reason", "the first")
    assert (code, "first baseline: 1 deck" in said) == (0, True)
    kept = {path.relative_to("eos-ref-baseline").as_posix() for path in Path("eos-ref-baseline").rglob("*.*")}
    files = {f"decks/in.deck/{name}.tsv" for name in ("steps", "step-0", "step-20", "thermo")}
    assert files | {"baseline.json", "verdicts.tsv", "reasons.jsonl"} <= kept
    assert json.loads(Path("eos-ref-baseline/reasons.jsonl").read_text())["reason"] == "the first"

    code, said, _ = eos_ref_command("audit", deck, "--baseline")
    assert (code, "same bits\n" in said, "changed" in said) == (0, True, False)
    before = {path: path.read_bytes() for path in Path("eos-ref-baseline").rglob("*") if path.is_file()}
    assert "(unchanged)" in eos_ref_command("audit", deck, "--accept").out
    assert {path: path.read_bytes() for path in before} == before

    for old, new, line in (
        ("constant 0.1", "constant 0.11", "viscosity from step 0 (exact): atom 1 at step 0: 0.1,"),
        ("fix 3", "timestep 0.0200001\nfix 3", "grad/v from step 10 (pass): atom 1 at step 20: "),
        ("rho 1.1", "rho 1.1000001", "rho from step 0 "),
    ):
        edit(deck, old, new)
        code, said, _ = eos_ref_command("audit", deck, "--baseline")
        assert code == 1 and "FAIL: " in said and f"changed: in.deck {line}" in said, said
        assert "changes against the baseline" in said and read_run(REPORT).changed > 5
        edit(deck, new, old)


@pytest.mark.lammps
@pytest.mark.slow
def test_another_engine_differs_only_by_a_finding(deck: Path, eos_ref_command: Run) -> None:
    eos_ref_command("audit", deck, "--accept", "--baseline", "kept")
    code, said, _ = eos_ref_command("audit", deck, "--baseline", "kept", "--engine", OTHER)
    assert code == 1
    assert "changed: in.deck f from step 0 (explained by force-per-volume, now pass): atom 1 at step 0: " in said
    assert "judged otherwise: in.deck (explained by force-per-volume, now pass)" in said
    assert "within bounds: " in said and "grad/v from" not in said  # other bits are not a fault of another program

    code, said, _ = eos_ref_command("compare", "env", OTHER, "--deck", deck, "--json")
    rows = {row["field"]: row["change"] for row in json.loads(said)["fields"]}
    expected = {"viscosity": "same bits", "grad/v": "within bounds", "f": "changed"}
    assert code == 1 and rows | expected == rows
    code, said, _ = eos_ref_command("bisect", OTHER, "env", "--deck", deck, "--field", "f", "--beyond-bounds")
    assert code == 1 and "env is the first that changed" in said
    code, said, err = eos_ref_command("bisect", OTHER, "env", "--deck", deck, "--case", "walls")
    assert (code, err) == (2, "eos-ref: --deck: must not be given with cases\n")


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--baseline",), "baseline: none is accepted here (eos-ref audit DECK --accept) (eos-ref-baseline)"),
        (("--reason", "why"), "--reason: needs --accept"),
        (("--accept", "--dump", "x"), "--accept or --baseline: is of a deck that runs, not of --dump or --restart"),
        (("--accept", "--baseline", "."), "baseline: must be a new folder, or hold an earlier baseline, found '.'"),
    ],
)
def test_bad_baselines_are_refused(words: tuple[str, ...], line: str, deck: Path, eos_ref_command: Run) -> None:
    code, _, err = eos_ref_command("audit", deck, *words)
    assert (code, err.splitlines()[-1]) == (2, f"eos-ref: {line}")
    assert not Path("eos-ref-baseline").exists()


@pytest.mark.lammps
def test_stored_text_is_read_back_exactly(deck: Path, eos_ref_command: Run) -> None:
    eos_ref_command("audit", deck, "--accept")
    report, accepted = read(REPORT), baseline.read(Path("eos-ref-baseline"))
    ours, theirs = report.cases["in.deck"], accepted.cases["in.deck"]
    assert ours.thermo == theirs.thermo and len(ours.thermo) == 3
    for name, field in ours.fields.items():
        one, other = ([(s.step, s.verdict, s.digest) for s in of.by_step] for of in (field, theirs.fields[name]))
        assert one == other and field.digest == theirs.fields[name].digest != ""
    for name in (*ours.fields, "x", "v", "rho"):
        pairs = [report.samples("in.deck").kept(name), accepted.samples("in.deck").kept(name)]
        assert [sample.step for sample in pairs[0]] == [0, 20]
        for one, other in zip(*pairs, strict=True):
            assert one.values_n.tobytes() == other.values_n.tobytes()
            assert (one.bound_n <= other.bound_n).all() and (other.bound_n <= 1.02 * one.bound_n).all()
    steps = Path("eos-ref-baseline/decks/in.deck/steps.tsv")
    steps.write_text(steps.read_text().replace("exact:", "good:", 1))
    with pytest.raises(InputError, match=r"baseline: is damaged: .*steps.tsv"):
        baseline.read(Path("eos-ref-baseline"))


def sample(values: list[float], bound: float, step: int = 0) -> Sample:
    table = np.array(values)[:, None]
    return Sample(step, table, np.full_like(table, bound), np.arange(1, len(values) + 1))


Found = tuple[int, float, float] | None


@pytest.mark.parametrize(
    ("now", "step", "found"),
    [
        ([1.0, 2.0], 0, None),
        ([1.0, 2.2], 0, None),  # twice the bound of either: both may be within it of one prediction
        ([1.0, 2.3], 0, (2, 2.0, 2.3)),
        ([float("nan"), 2.0], 0, (1, 1.0, float("nan"))),
        ([1.0, 2.3], 10, None),
        ([1.0], 0, None),
    ],
)
def test_values_differ_beyond_the_bounds_of_both(now: list[float], step: int, found: Found) -> None:
    far = outcomes.beyond(sample([1.0, 2.0], 0.1), sample(now, 0.1 + 1e-9, step))
    assert repr(far and (far.atom, far.was, far.now)) == repr(found)


# --- decks of a folder, and settings


@pytest.mark.lammps
@pytest.mark.slow
def test_folder_of_decks(deck: Path, eos_ref_command: Run) -> None:
    folder = Path("decks")
    (folder / "sub").mkdir(parents=True)
    for name in ("in.a", "sub/b.in", "sub/in.skipped", "sub/start.txt"):
        shutil.copy(deck, folder / name)
    for place in (folder, folder / "sub"):
        shutil.copy("fluid.inc", place)
    (folder / "in.shell").write_text("units lj\nshell ls\n")
    (folder / "data.lmp").write_text("particles\n\n10 atoms\n")
    toml = folder / command.SETTINGS
    toml.write_text(
        'steps = 10\ndecks = ["sub/start.txt"]\nskip = ["*skipped"]\n[deck."b.in"]\nevery = 5\n[allow]\n'
        'force-per-volume = "until 2999-03, waiting for upstream"\ncubic-unit = "until 2026-01-31, old"\n'
        'rmin-unit = "until 2999-03, not here"\n'
    )
    code, said, _ = eos_ref_command("audit", folder, "--fail-on", "high", "--out", "out")
    run = read_run(Path("out"))
    assert [case.case for case in run.cases] == ["in.a", "in.shell", "sub_b.in", "sub_start.txt"]
    assert [case.verdict for case in run.cases] == ["explained", "error", "explained", "explained"]
    assert "command shell: not allowed" in run.cases[1].message
    assert [[c.step for c in case.checks if c.field == "f"] for case in run.cases] == [[0, 10], [], [0, 5, 10], [0, 10]]
    assert code == 3 and "FAIL: 1 of 4 decks: in.shell: command shell: not allowed" in said and "rejected" not in said
    assert run.allowed == {"force-per-volume": "until 2999-03-31, waiting for upstream"}
    assert run.notes == [
        "eos-ref.toml: the allowance of cubic-unit expired on 2026-01-31: old",
        "eos-ref.toml: the allowance of rmin-unit is unused: no deck of this run shows it (not here)",
    ]
    (folder / "in.shell").unlink()
    assert eos_ref_command("audit", folder, "--fail-on", "high", "--accept").code == 0
    (folder / "sub" / "b.in").unlink()
    edit(folder / "in.a", "viscosity * constant 0.1", "viscosity * constant 0.11")
    toml.write_text(toml.read_text().replace("2999-03, waiting", "2026-03, waiting"))
    code, said, _ = eos_ref_command("audit", folder, "--fail-on", "high", "--baseline")
    assert code == 1 and "rejected by --fail-on high" in said
    assert "missing case: 1 case (sub_b.in)" in said and "changed: in.a viscosity from step 0" in said
    assert "changed: sub_start.txt" not in said


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("every = 0", "every: must be 1 to 2147483647 time steps, found 0"),
        ('every = "5"', "every: Input should be a valid integer, found '5'"),
        ("steps = 5\nstep = 5", "step: Extra inputs are not permitted, found 5"),
        ('fields = ["presure"]', "field: must be one of all"),
        ('[deck."in.*"]\nallow = "x"', "deck.in.*.allow: Extra inputs are not permitted, found 'x'"),
        ("every = ", "settings: must be TOML: Invalid value"),
        ('[allow]\nforce = "until 2027-03, x"', "no such finding: 'force'"),
        *(
            (f'[allow]\nforce-per-volume = "{words}"', "allow.force-per-volume: must be 'until YEAR-MONTH, REASON'")
            for words in ("waiting", "until 2027-13, x")
        ),
    ],
)
def test_bad_settings_are_refused(text: str, line: str, tmp_path: Path) -> None:
    (tmp_path / command.SETTINGS).write_text(text)
    with pytest.raises(InputError) as raised:
        command.read_settings(tmp_path)
    said = str(raised.value)
    assert said.startswith(line) and said.endswith(f"({tmp_path / command.SETTINGS})") and "\n" not in said


def test_documented_settings_are_read_and_overridden_by_the_command_line(tmp_path: Path) -> None:
    documented = (Path(__file__).parents[3] / "docs" / "audit.md").read_text()
    (tmp_path / command.SETTINGS).write_text(documented.split("```toml\n")[1].split("```")[0])
    of_file = command.read_settings(tmp_path)
    assert set(command.Settings.model_fields) - {"fields"} == of_file.model_fields_set
    assert of_file.options("in.tank.2", AuditOptions()).fields == ("pressure", "f")
    (tmp_path / command.SETTINGS).write_text('every = 5\nsteps = 100\n[deck."in.t*"]\nsteps = 7\nfields = ["f"]')
    read_settings = command.read_settings(tmp_path)
    of_tank = read_settings.options("in.tank", AuditOptions())
    assert (of_tank.every, of_tank.steps, of_tank.fields) == (5, 7, ("f",))
    other = read_settings.options("in.other", AuditOptions(every=3))
    assert (other.every, other.steps) == (3, 100)


@pytest.mark.parametrize(("until", "last"), [("2027-02", "2027-02-28"), ("2027-02-10", "2027-02-10")])
def test_allowance_holds_until_the_end_of_its_day_or_month(until: str, last: str) -> None:
    allowances = command.Settings(allow={"force-per-volume": f"until {until}, x"})
    for days, holds in ((0, True), (1, False)):
        held, notes = allowances.allowed({"force-per-volume"}, date.fromisoformat(last) + timedelta(days))
        assert (bool(held), bool(notes)) == (holds, not holds)
