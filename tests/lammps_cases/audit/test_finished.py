"""Audits of finished output: dumps and restart files written by real LAMMPS, unchanged and with planted faults."""

from __future__ import annotations

import dataclasses
import functools
import gzip
import random
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.audit import command, fields, finished, supervise
from lammps_cases.audit.dumps import number
from lammps_cases.audit.messages import DeckSetups
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.verdict import Findings
from lammps_cases.records.case_parts import worst
from lammps_cases.records.run_record import CaseRecord
from tests.support.audited_decks import DECKS, run_plain

pytestmark = pytest.mark.lammps

SURFACE = "surface surface/n/* surface/r surface/divr"
HEAT = "temperature energy heatflow cv conductivity"
STATE = "phase rho pressure coordination grad/v/* viscosity stress/v/* stress/t/*"
Run = Callable[..., tuple[int, str, str]]
PLACES = "id type x y z vx vy vz fx fy fz"
# Decks with dumps of three formats put before their first run, and the columns of each.
COLUMNS = {"box": "shift/v/*", "summed": f"{SURFACE} shift/v/*", "power": f"{SURFACE} {HEAT}", "walls_quintic": "chi"}
FORMATS = {
    "six": "",
    "fifteen": "sort id format float %20.15g",
    "all": "format float %.17g",
    "few": "format float %.3f",
}


def inlined(name: str) -> list[str]:
    """The lines of a deck, with those of its includes."""
    lines: list[str] = []
    for line in (DECKS / name).read_text().splitlines():
        included = re.fullmatch(r"include\s+(\w+\.inc)", line)
        lines += inlined(included[1]) if included else [line]
    return lines


def with_dumps(name: str) -> str:
    lines = inlined(f"in.{name}")
    at = next(k for k, line in enumerate(lines) if line.startswith("run "))
    dumps = [f"compute of_audit all rheo/property/atom {STATE} {COLUMNS[name]}", "compute rates all property/atom drho"]
    for label, form in FORMATS.items():
        dumps += [f"dump {label} all custom 5 {label}.dump {PLACES} c_rates c_of_audit[*]"]
        dumps += [f"dump_modify {label} {form}"] if form else []
    rest = PLACES.partition("z ")[2]
    for label, places in {"scaled": "xs ys zs", "unwrapped": "xu yu zu"}.items():
        dumps += [f"dump {label} all custom 5 {label}.dump id type {places} {rest} c_rates c_of_audit[*]"]
        dumps += [f"dump_modify {label} {FORMATS['fifteen']} sort {'-1' if label == 'scaled' else 'id'}"]
    dumps += [f"dump binary all custom 5 all.bin {PLACES} c_rates c_of_audit[*]"]
    return "\n".join([*lines[:at], *dumps, "restart 5 kept.*", *lines[at:], ""])


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder of a deck after LAMMPS has run it, with all output."""

    @functools.cache
    def run(name: str) -> Path:
        folder = tmp_path_factory.mktemp(name)
        (folder / "in.deck").write_text(with_dumps(name))
        run_plain("in.deck", folder)
        return folder

    return run


@functools.cache
def described(deck: Path) -> tuple[dict[str, str], DeckSetups]:
    findings, setups = supervise.described(deck, AuditOptions())
    return findings.who, setups


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run LAMMPS only once per deck to describe it."""
    monkeypatch.setattr(finished, "described", lambda deck, _: (Findings(who=described(deck)[0]), described(deck)[1]))


def audited(dump: Path, *fields: str) -> CaseRecord:
    options = AuditOptions(fields=fields or ("all",))
    return finished.audit_dump(dump, dump.parent / "in.deck", options).record.cases[0]


def verdicts(case: CaseRecord) -> dict[str, str]:
    return {field.field: field.verdict for field in case.fields}


# --- what LAMMPS wrote is inside the bounds of the digits

KNOWN = {"f": "explained", "heatflow": "explained"}
MOVED = dict.fromkeys(("grad/v", "f"), "explained")
STRESS = {"grad/v", "viscosity", "stress/v", "stress/t"}
FOUND: dict[str, tuple[set[str], dict[str, str]]] = {
    "box": (STRESS | {"coordination", "pressure", "shift/v", "drho", "f"}, KNOWN),
    "summed": (STRESS | {"coordination", "pressure", "rho", "shift/v", "drho", "f"} | set(SURFACE.split()), KNOWN),
    "power": (STRESS | {"coordination", "pressure", "drho", "f"} | set(f"{SURFACE} {HEAT}".split()), KNOWN),
    "walls_quintic": (STRESS | {"coordination", "pressure", "chi", "drho", "f"}, MOVED),
}


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("label", FORMATS)
@pytest.mark.parametrize("name", FOUND)
def test_dumps_of_all_formats(name: str, label: str, written: Callable[[str], Path]) -> None:
    case = audited(written(name) / f"{label}.dump")
    expected = {field.removesuffix("/*") for field in FOUND[name][0]} - {"energy"}
    judged = verdicts(case)
    open_ = {line.partition(":")[0] for line in case.not_checked if "no particle can be compared" in line}
    assert judged.keys() | (open_ if label == "few" else set()) == expected
    allowed = {"exact", "pass"}
    for field, verdict in judged.items():
        coarse = label == "few" and verdict in allowed  # three digits may hide what the finding does
        assert verdict == FOUND[name][1].get(field, verdict if verdict in allowed else "pass") or coarse, field
    steps = sorted({check.step for check in case.checks})
    assert steps[0] == 0 and len(steps) >= 3 and case.blame is None


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("label", ["scaled", "unwrapped"])
@pytest.mark.parametrize("name", ["box", "walls_quintic"])
def test_positions_in_other_forms(name: str, label: str, written: Callable[[str], Path]) -> None:
    case, plain = (audited(written(name) / f"{form}.dump") for form in (label, "fifteen"))
    known = {field: verdict for field, verdict in verdicts(plain).items() if verdict == "explained"}
    assert verdicts(case).keys() == verdicts(plain).keys()
    assert {field: verdict for field, verdict in verdicts(case).items() if verdict not in ("exact", "pass")} == known
    assert [check.step for check in case.checks] == [check.step for check in plain.checks]


@pytest.mark.usefixtures("quick")
def test_unwrapped_positions_may_lie_several_edges_away(written: Callable[[str], Path]) -> None:
    dump = written("box") / "unwrapped.dump"
    lines = [line.split() for line in dump.read_text().splitlines()]
    rows = [words for words in lines if len(words) == len(headers("box")) and words[0].isdigit()]
    assert len(rows) == 3 * 125
    for words in rows[::2]:
        words[2] = repr(float(words[2]) + 3 * 5.0)  # edges of the box
    far = dump.with_name("far.dump")
    far.write_text("".join(" ".join(words) + "\n" for words in lines))
    assert verdicts(audited(far)) == verdicts(audited(dump))


@pytest.mark.usefixtures("quick")
def test_gzipped_dump_is_unpacked(written: Callable[[str], Path]) -> None:
    dump = written("box") / "fifteen.dump"
    packed = dump.with_name("fifteen.dump.gz")
    packed.write_bytes(gzip.compress(dump.read_bytes()))
    assert verdicts(audited(packed)) == verdicts(audited(dump))


@pytest.mark.usefixtures("quick")
def test_binary_dump_equals_dump_with_all_digits(written: Callable[[str], Path]) -> None:
    binary, text = (audited(written("box") / name) for name in ("all.bin", "all.dump"))
    assert [field.model_dump() for field in binary.fields] == [field.model_dump() for field in text.fields]
    assert len(binary.fields) >= 9


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("name", ["all.bin", "six.dump"])
def test_complete_snapshots_of_a_truncated_dump_are_judged(name: str, written: Callable[[str], Path]) -> None:
    content = (written("box") / name).read_bytes()
    cut = written("box") / f"cut.{name}"
    steps = set()
    for share in (0.3, 0.5, 0.66, 0.67, 0.9, 0.999):
        cut.write_bytes(content[: int(share * len(content))])
        if share < 1 / 3:
            with pytest.raises(InputError, match="must end with a whole snapshot, found "):
                audited(cut)
            continue
        case = audited(cut)
        judged = sorted({check.step for check in case.checks})
        assert judged == [0, 5][: int(3 * share)]
        (warning,) = case.warnings
        last = int(judged[-1])
        assert warning.startswith(f"the dump is cut off after step {last}: not judged is the rest, ")
        assert f"of 125 atoms of step {last + 5}" in warning or "a part of a header" in warning
        steps.add(last)
    assert steps == {0, 5}


@pytest.mark.usefixtures("quick")
def test_bounds_follow_the_printed_digits(written: Callable[[str], Path]) -> None:
    """The largest difference of each format comes near its bound, and bounds shrink with more digits."""
    bounds = {}
    for label in ("six", "fifteen"):
        field = next(f for f in audited(written("box") / f"{label}.dump").fields if f.field == "pressure")
        assert 0.3 < (field.max_over_bound or 0) <= 1
        bounds[label] = field.bound or 0
    assert bounds["six"] > 1e7 * bounds["fifteen"]


@pytest.mark.parametrize("form", ["%g", "%.3g", "%20.15g", "%.3f", "%.1f", "%e", "%.2e", "%.0g"])
def test_errors_of_printed_numbers(form: str) -> None:
    rng = random.Random(5)
    values = [rng.uniform(-1, 1) * 10.0 ** rng.randint(-4, 5) for _ in range(2000)] + [0.0, 1.0, 1000.0, 999.9996]
    read = number(np.array([float(form % v) for v in values]), form)
    ratio = np.abs(read.value - values) / np.where(read.error > 0, read.error, 1)
    assert ratio.max() <= 1 and ratio.max() > 0.9


def test_formats_with_all_digits_are_exact() -> None:
    for form in ("%.17g", "%25.20g", "%.16e"):
        assert not number(np.array([0.1, 1e300]), form).error.any()
    with pytest.raises(InputError, match="one of %e, %f and %g"):
        number(np.array([0.1]), "%a")


# --- planted faults

DIRECT = {
    "box": ("coordination", "grad/v", "shift/v", "viscosity", "pressure", "stress/v", "stress/t", "drho", "f"),
    "summed": ("rho", "surface", "surface/r", "surface/n", "surface/divr"),
    "power": ("temperature", "heatflow", "cv", "conductivity"),
    "walls_quintic": ("chi",),
}
TELLS = {"box": {"x": "grad/v", "vx": "grad/v", "fx": "grad/v", "rho": "pressure"}, "power": {"energy": "temperature"}}


def headers(name: str) -> list[str]:
    """The names of the columns after the positions, in order, by their content."""
    d = 3 if name == "box" else 2
    ranks = {"grad/v": 2, "stress/v": 2, "stress/t": 2, "shift/v": 1, "surface/n": 1}
    words = [word.removesuffix("/*") for word in f"{STATE} {COLUMNS[name]}".split()]
    return [*PLACES.split(), "drho", *(word for word in words for _ in range(d ** ranks.get(word, 0)))]


def planted(dump: Path, column: str, name: str, folder: Path, frame: int, grow: float) -> tuple[Path, int]:
    """Change one atom's value of a column in one snapshot of a copy; return the copy and the atom."""
    lines = dump.read_text().splitlines()
    starts = [k for k, line in enumerate(lines) if line.startswith("ITEM: ATOMS")]
    at = headers(name).index({"f": "fx"}.get(column, column))
    end = starts[frame] + 1 + int(lines[starts[frame] - 5])
    rows = range(starts[frame] + 1, end)
    row = max(rows, key=lambda k: abs(float(lines[k].split()[at])))
    words = lines[row].split()
    words[at] = repr(float(words[at]) * (1 + grow) + grow)
    lines[row] = " ".join(words)
    copy = folder / dump.name
    copy.write_text("\n".join(lines) + "\n")
    shutil.copy(dump.parent / "in.deck", folder)
    return copy, int(words[0])


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("frame, label, grow", [(2, "all", 1e-6), (0, "six", 1e-1)])
@pytest.mark.parametrize("name, field", [(name, field) for name, fields in DIRECT.items() for field in fields])
def test_planted_column_is_detected(
    name: str, field: str, label: str, grow: float, frame: int, written: Callable[[str], Path], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    folder = written(name)
    copy, atom = planted(folder / f"{label}.dump", field, name, tmp_path, frame, grow)
    monkeypatch.setattr(finished, "described", lambda *_: (Findings(who=described(folder / "in.deck")[0]),
                                                           described(folder / "in.deck")[1]))  # fmt: skip
    result = finished.audit_dump(copy, copy.parent / "in.deck", AuditOptions(fields=("all",)))
    (case,) = result.record.cases
    bad = [check for check in case.checks if check.verdict == "differs" and check.field == field]
    assert [check.step for check in bad] == [5 * frame] == [int(result.arrays["step"])]
    assert field in KNOWN or bad[0].worst_id == atom  # a known difference of other atoms may be larger


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("name, column, field", [(n, c, f) for n, tells in TELLS.items() for c, f in tells.items()])
def test_planted_state_is_detected_by_dependent_fields(
    name: str, column: str, field: str, written: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = written(name)
    copy, _ = planted(folder / "all.dump", column, name, tmp_path, 2, 1e-4)
    monkeypatch.setattr(finished, "described", lambda *_: (Findings(who=described(folder / "in.deck")[0]),
                                                           described(folder / "in.deck")[1]))  # fmt: skip
    bad = [check for check in audited(copy).checks if check.verdict == "differs" and check.field == field]
    assert [check.step for check in bad] == [10]


@pytest.mark.parametrize("label", ["scaled", "unwrapped"])
def test_planted_position_is_detected(
    label: str, written: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = written("box")
    copy, _ = planted(folder / f"{label}.dump", "x", "box", tmp_path, 2, 1e-4)
    described_by = Findings(who=described(folder / "in.deck")[0]), described(folder / "in.deck")[1]
    monkeypatch.setattr(finished, "described", lambda *_: described_by)
    bad = [check.step for check in audited(copy).checks if check.verdict == "differs" and check.field == "grad/v"]
    assert bad == [10]


# --- what is not checked, and why


@pytest.mark.parametrize(
    ("reasons", "says"),
    [
        ({("chi", fields.ABSENT): [0], ("coordination", finished.NO_COLUMN): [0], ("f", finished.NO_FORCES): [0]},
         "it lacks coordination, f: see compute rheo/property/atom"),
        ({("chi", fields.ABSENT): [0]}, f"chi: {fields.ABSENT}"),
    ],
)  # fmt: skip
def test_dump_without_checkable_columns_names_the_missing_ones(reasons: Any, says: str) -> None:
    audit = finished._Audit.__new__(finished._Audit)
    audit.findings, audit.reasons = Findings(), reasons
    with pytest.raises(InputError, match=rf"that can be checked against each other; {re.escape(says)}.*\(a\.dump\)"):
        audit.end("a.dump")


def cut(dump: Path, keep: Sequence[str], name: str, folder: Path) -> Path:
    """A copy with only some columns, as if the deck had dumped no more."""
    lines, numbers = [], [k for k, what in enumerate(headers(name)) if what in keep]
    inside = False
    for line in dump.read_text().splitlines():
        words = line.split()
        if line.startswith("ITEM: "):
            inside = line.startswith("ITEM: ATOMS")
            lines.append(" ".join(["ITEM:", "ATOMS", *(words[2 + k] for k in numbers)]) if inside else line)
        else:
            lines.append(" ".join(words[k] for k in numbers) if inside else line)
    copy = folder / dump.name
    copy.write_text("\n".join(lines) + "\n")
    return copy


def writing(setups: DeckSetups, label: str, dump: Path, group: str = "all", modify: Sequence[str] = ()) -> DeckSetups:
    """The set-ups of a deck whose dump writes the columns that a file has."""
    columns = next(line for line in dump.read_text().splitlines() if line.startswith("ITEM: ATOMS")).split()[2:]
    dumps = [
        dataclasses.replace(d, words=[d.words[0], group, *d.words[2:5], *columns], modify=[*d.modify, *modify])
        for d in setups.dumps
        if d.words[0] == label
    ]
    return dataclasses.replace(setups, dumps=dumps)


@pytest.mark.parametrize(
    "keep, compared, at_first, reason",
    [
        ("rho pressure", {"pressure"}, set(), "f: no columns fx fy fz in the dump"),
        ("x y z rho coordination", {"coordination"}, set(), "pressure: no column of it in the dump (compute rheo/"),
        ("rho coordination pressure", {"pressure"}, set(), "coordination: the dump lacks columns x y z"),
        ("grad/v viscosity stress/v", {"viscosity", "stress/v"}, set(), "grad/v: the dump lacks columns x y z, rho,"),
        ("x y z vx vy vz rho grad/v", set(), {"grad/v"}, "grad/v: the dump lacks a column of drho (compute property"),
        ("x y z vx vy vz rho grad/v drho", {"drho"}, {"grad/v"}, "columns fx fy fz, as the forces saw the state half"),
    ],
)
def test_fields_with_missing_columns_are_not_checked(
    keep: str, compared: set[str], at_first: set[str], reason: str,
    written: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    folder = written("box")
    copy = cut(folder / "all.dump", ["id", "type", *keep.split()], "box", tmp_path)
    who, setups = described(folder / "in.deck")
    monkeypatch.setattr(finished, "described", lambda *_: (Findings(who=who), writing(setups, "all", copy)))
    if not compared | at_first:
        with pytest.raises(InputError, match="can be checked"):
            audited(copy)
        return
    case = audited(copy)
    assert {check.field for check in case.checks} == compared | at_first
    assert {check.field for check in case.checks if check.step > 0} == compared
    assert all(check.verdict in ("exact", "pass") for check in case.checks)
    assert any(reason in line for line in case.not_checked), case.not_checked
    assert all("(steps 5, 10)" in line for line in case.not_checked if line.partition(":")[0] in at_first)


@pytest.mark.parametrize(
    "group_, modify, word", [("half", (), "group half"), ("all", ("thresh", "x", "<", "2"), "thresh")]
)
def test_sums_need_all_particles(
    group_: str, modify: Sequence[str], word: str, written: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = written("box")
    dump = folder / "all.dump"
    who, setups = described(folder / "in.deck")
    partial = writing(setups, "all", dump, group_, modify)
    monkeypatch.setattr(finished, "described", lambda *_: (Findings(who=who), partial))
    case = audited(dump)
    assert {check.field for check in case.checks} == {"pressure", "viscosity", "stress/v", "stress/t"}
    assert any(line.startswith("f: the dump holds") and word in line for line in case.not_checked)


def test_fixes_moving_particles_after_the_forces(
    written: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = written("box")
    who, setups = described(folder / "in.deck")
    fixes = {"9": ["fix", "9", "all", "momentum", "1", "linear", "1", "1", "1"]}
    moved = [
        dataclasses.replace(run, deck=dataclasses.replace(run.deck, fixes=run.deck.fixes | fixes))
        for run in setups.runs
    ]
    changed = dataclasses.replace(setups, runs=moved)
    monkeypatch.setattr(finished, "described", lambda *_: (Findings(who=who), changed))
    case = audited(folder / "all.dump")
    assert {check.field for check in case.checks if check.step} == {"pressure", "viscosity", "stress/v", "stress/t"}
    assert any("fix 9 (momentum) may move particles" in line for line in case.not_checked)


@pytest.mark.usefixtures("quick")
def test_renamed_columns_and_chosen_fields(written: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch) -> None:
    folder = written("box")
    assert verdicts(audited(folder / "all.dump", "pressure", "drho")).keys() == {"pressure", "drho"}
    who, setups = described(folder / "in.deck")
    named = [
        dataclasses.replace(d, modify=[*d.modify, "colname", "c_of_audit[3]", "P"])
        for d in setups.dumps
        if d.words[0] == "all"
    ]
    monkeypatch.setattr(finished, "described", lambda *_: (Findings(who=who), dataclasses.replace(setups, dumps=named)))
    text = (folder / "all.dump").read_text().replace("c_of_audit[3]", "P")
    (folder / "renamed.dump").write_text(text)
    assert "pressure" in verdicts(audited(folder / "renamed.dump"))


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("column", "value", "reason"),
    [
        ("x", "nan", "grad/v: positions are not numbers (steps 0)"),
        ("x", "1e300", "grad/v: positions are not known to within the cutoff (steps 0)"),
        ("vx", "nan", "particles cannot be compared, by the digits"),
        ("rho", "inf", "pressure: 1 of 125 particles cannot be compared, by the digits"),
    ],
)
def test_nan_excludes_particles(column: str, value: str, reason: str, written: Callable[[str], Path]) -> None:
    folder = written("box")
    lines = (folder / "all.dump").read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("ITEM: ATOMS")) + 1
    words = lines[at].split()
    words[headers("box").index(column)] = value
    (folder / "changed.dump").write_text("\n".join([*lines[:at], " ".join(words), *lines[at + 1 :], ""]))
    case = audited(folder / "changed.dump")
    assert any(reason in line for line in case.not_checked), case.not_checked
    assert {check.field for check in case.checks if check.step == 0} >= {"viscosity", "pressure"}
    if value == "1e300":
        assert case.broke is None
        return
    name = lines[at - 1].split()[2:][headers("box").index(column)]
    assert case.verdict == worst(["error", *(field.verdict for field in case.fields)]) and case.broke is not None
    assert (case.broke.step, case.broke.column, case.broke.atom) == (0, name, int(words[0]))
    assert (case.broke.particles, case.broke.of) == (1, 125) and str(case.broke.value) == value


# --- restart files


def test_restart_is_judged_by_field(written: Callable[[str], Path]) -> None:
    folder = written("box")
    case = command.audit_restart(folder / "kept.5", folder / "in.deck", AuditOptions()).record.cases[0]
    assert case.case == "kept.5" and {check.step for check in case.checks} == {5}
    assert verdicts(case) == dict.fromkeys(verdicts(case), "pass") | {
        field: verdict for field, verdict in verdicts(case).items() if verdict in ("exact", "explained")
    }
    assert {"pressure", "grad/v", "shift/v", "f"} <= verdicts(case).keys()


def test_restart_uses_fixes_of_its_run(written: Callable[[str], Path], tmp_path: Path) -> None:
    """A law defined for a later run does not apply to the restart file of an earlier one."""
    text = (written("box") / "in.deck").read_text().splitlines()
    (tmp_path / "in.deck").write_text("\n".join([*text, "unfix 3", "fix 3 all rheo/pressure * linear", "run 5", ""]))
    shutil.copy(written("box") / "kept.5", tmp_path)
    case = command.audit_restart(tmp_path / "kept.5", tmp_path / "in.deck", AuditOptions()).record.cases[0]
    assert [law.style for law in case.laws] == ["cubic"]


# --- bad input


@pytest.mark.parametrize(
    "arguments, message",
    [
        (("--dump", "all.dump"), "deck: must be given once"),
        (("in.deck", "--deck", "in.deck"), "deck: must be given once"),
        (("in.deck", "--dump", "all.dump", "--restart", "kept.5"), "restart"),
        (("in.deck", "--dump", "none.dump"), "file: cannot be read: No such file"),
        (("in.deck", "--dump", "in.deck"), "must be one of text"),
        (("in.deck", "--dump", "cut.dump"), "must end with a whole snapshot"),
        (("in.deck", "--dump", "empty.dump"), "must hold a snapshot"),
        (("in.deck", "--dump", "all.nc"), "dump: must be of dump custom, not of dump netcdf: OVITO converts it"),
        (("in.deck", "--dump", "cut.dump.gz"), "dump: cannot be unpacked by gzip"),
        (("in.deck", "--dump", "late.dump"), "must be one of the runs of the deck that write it (steps 0 to 10)"),
        (("in.deck", "--dump", "other.dump"), "must be those that a dump of the deck writes: id type x"),
        (("in.deck", "--dump", "noid.dump"), "must hold id"),
        (("in.deck", "--dump", "word.dump"), "must hold numbers"),
        (("in.deck", "--dump", "types.dump"), "type: must lie within 1 to 1, found 9 (types.dump, step 0)"),
        (("in.deck", "--dump", "twice.dump"), "id: must differ from particle to particle (twice.dump, step 0)"),
        (("in.nothing", "--dump", "all.dump"), "deck: no such file"),
        (("in.deck", "--restart", "none"), "restart: must be a readable file"),
        (("in.deck", "--restart", "all.dump"), "restart: must be readable by LAMMPS"),
        (("in.short", "--restart", "kept.10"), "step: must be one of the deck's runs (steps 0 to 2)"),
    ],
)
@pytest.mark.usefixtures("quick")
def test_bad_input_gives_a_one_line_message(
    arguments: Sequence[str], message: str, written: Callable[[str], Path], eos_ref_command: Run,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    folder = written("box")
    whole = (folder / "all.dump").read_text()
    (folder / "cut.dump").write_text(whole[:2000])
    (folder / "all.nc").write_bytes(b"CDF\x02\0\0\0\0")
    (folder / "empty.dump").write_text("")
    (folder / "cut.dump.gz").write_bytes(gzip.compress(whole.encode())[:99])
    (folder / "late.dump").write_text(whole.replace("TIMESTEP\n10\n", "TIMESTEP\n99\n"))
    (folder / "other.dump").write_text(whole.replace("c_rates", "c_other"))
    (folder / "noid.dump").write_text(whole.replace("ATOMS id", "ATOMS mol"))
    (folder / "word.dump").write_text(re.sub(r"(ITEM: ATOMS.*\n\d+ \d+) \S+", r"\1 much", whole))
    row = re.compile(r"(?<=\n)1 1 ")
    (folder / "types.dump").write_text(row.sub("1 9 ", whole))
    (folder / "twice.dump").write_text(row.sub("2 1 ", whole))
    (folder / "in.short").write_text((folder / "in.deck").read_text().replace("run             10", "run 2"))
    monkeypatch.chdir(folder)
    code, _, complaint = eos_ref_command("audit", *arguments, "--out", "report")
    assert (code, complaint.count("\n")) == (2, 1), complaint
    assert message in complaint
    assert not (folder / "report").exists()
