"""Audits of finished output: dumps and restart files written by real LAMMPS, unchanged and with planted faults."""

from __future__ import annotations

import gzip
import random
import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.audit import command, finished, supervise
from lammps_cases.audit.dumps import number
from lammps_cases.audit.messages import DeckSetups
from lammps_cases.audit.options import AuditOptions, AuditResult
from lammps_cases.audit.verdict import Findings
from lammps_cases.records.case_parts import Verdict, worst
from lammps_cases.records.run_record import CaseRecord
from tests.support.audited_decks import case_of, inlined, run_plain
from tests.support.outcome import Outcome

pytestmark = pytest.mark.lammps

SURFACE = "surface surface/n/* surface/r surface/divr"
HEAT = "temperature energy heatflow cv conductivity"
STATE = "phase rho pressure coordination grad/v/* viscosity stress/v/* stress/t/*"
PLACES = "id type x y z vx vy vz fx fy fz"
# Decks with dumps of several formats put before their first run, and the columns of each.
COLUMNS = {"box": "shift/v/*", "summed": f"{SURFACE} shift/v/*", "power": f"{SURFACE} {HEAT}", "walls_quintic": "chi"}
FIFTEEN = "format float %20.15g"
FORMATS = {"six": "", "fifteen": f"sort id {FIFTEEN}", "all": "format float %.17g", "few": "format float %.3f"}
PASSING = {"exact", "pass"}


def with_dumps(name: str) -> str:
    lines = inlined(f"in.{name}")
    at = next(k for k, line in enumerate(lines) if line.startswith("run "))
    dumps = [f"compute of_audit all rheo/property/atom {STATE} {COLUMNS[name]}", "compute rates all property/atom drho"]
    rest = PLACES.partition("z ")[2]
    forms = {label: (PLACES, form) for label, form in FORMATS.items()}
    forms |= {"scaled": (f"id type xs ys zs {rest}", f"{FIFTEEN} sort -1")}
    forms |= {"unwrapped": (f"id type xu yu zu {rest}", f"{FIFTEEN} sort id")}
    for label, (places, form) in forms.items():
        dumps += [f"dump {label} all custom 5 {label}.dump {places} c_rates c_of_audit[*]"]
        dumps += [f"dump_modify {label} {form}"] if form else []
    dumps += [f"dump binary all custom 5 all.bin {PLACES} c_rates c_of_audit[*]"]
    return "\n".join([*lines[:at], *dumps, "restart 5 kept.*", *lines[at:], ""])


def headers(name: str) -> list[str]:
    """The contents of the columns of a dump, in order."""
    d = 3 if name == "box" else 2
    ranks = {"grad/v": 2, "stress/v": 2, "stress/t": 2, "shift/v": 1, "surface/n": 1}
    words = [word.removesuffix("/*") for word in f"{STATE} {COLUMNS[name]}".split()]
    return [*PLACES.split(), "drho", *(word for word in words for _ in range(d ** ranks.get(word, 0)))]


@dataclass(frozen=True)
class Written:
    """A deck after LAMMPS has run it, with all output, and its description by LAMMPS."""

    name: str
    folder: Path
    who: dict[str, str]
    setups: DeckSetups

    def audit(self, dump: str | Path, *names: str, setups: DeckSetups | None = None) -> AuditResult:
        """Audit a dump of the folder, or a copy; LAMMPS describes the deck only once for all tests."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(finished, "described", lambda *_: (Findings(who=self.who), setups or self.setups))
            options = AuditOptions(fields=names or ("all",))
            return finished.audit_dump(self.folder / dump, self.folder / "in.deck", options)

    def case(self, dump: str | Path, *names: str, setups: DeckSetups | None = None) -> CaseRecord:
        return case_of(self.audit(dump, *names, setups=setups))

    def edited(
        self, dump: str, to: Path, frame: int, column: str, change: Callable[[str], str] | str
    ) -> tuple[Path, list[str]]:
        """A copy of a dump with a new number in one snapshot, where it was largest; and the old words of the atom.

        A text as the new number is written into a copy of that snapshot alone.
        """
        lines = (self.folder / dump).read_text().splitlines()
        start = [k for k, line in enumerate(lines) if line.startswith("ITEM: ATOMS")][frame]
        at = headers(self.name).index({"f": "fx"}.get(column, column))
        rows = range(start + 1, start + 1 + int(lines[start - 5]))
        row = max(rows, key=lambda k: abs(float(lines[k].split()[at])))
        words = lines[row].split()
        new = change if isinstance(change, str) else change(words[at])
        lines[row] = " ".join([*words[:at], new, *words[at + 1 :]])
        alone = slice(start - 8, rows.stop) if isinstance(change, str) else slice(None)
        (to / dump).write_text("\n".join(lines[alone]) + "\n")
        return to / dump, [*words, lines[start].split()[2 + at]]

    def dumping(self, label: str, change: Callable[[list[str], list[str]], tuple[list[str], list[str]]]) -> DeckSetups:
        """The set-ups with one dump alone, whose words and modifications are changed."""
        dumps = [(d, change(d.words, d.modify)) for d in self.setups.dumps if d.words[0] == label]
        return replace(self.setups, dumps=[replace(d, words=words, modify=more) for d, (words, more) in dumps])


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Written]:
    @cache
    def run(name: str) -> Written:
        folder = tmp_path_factory.mktemp(name)
        (folder / "in.deck").write_text(with_dumps(name))
        run_plain(folder / "in.deck")
        findings, setups = supervise.described(folder / "in.deck", AuditOptions())
        return Written(name, folder, findings.who, setups)

    return run


Decks = Callable[[str], Written]


@pytest.fixture
def box(written: Decks) -> Written:
    return written("box")


def verdicts(case: CaseRecord) -> dict[str, Verdict]:
    return {field.field: field.verdict for field in case.fields}


# --- what LAMMPS wrote is inside the bounds of the digits

KNOWN = {"f": "explained", "heatflow": "explained"}
MOVED = dict.fromkeys(("grad/v", "f"), "explained")
BASIC = {"grad/v", "viscosity", "stress/v", "stress/t", "coordination", "pressure", "drho", "f"}
FOUND: dict[str, tuple[set[str], dict[str, str]]] = {
    "box": (BASIC | {"shift/v"}, KNOWN),
    "summed": (BASIC | {"rho", "shift/v"} | set(SURFACE.split()), KNOWN),
    "power": (BASIC | set(f"{SURFACE} {HEAT}".split()), KNOWN),
    "walls_quintic": (BASIC | {"chi"}, MOVED),
}


@pytest.mark.parametrize("label", FORMATS)
@pytest.mark.parametrize("name", FOUND)
def test_dumps_of_all_formats(name: str, label: str, written: Decks) -> None:
    case = written(name).case(f"{label}.dump")
    expected = {field.removesuffix("/*") for field in FOUND[name][0]} - {"energy"}
    judged = verdicts(case)
    open_ = {line.partition(":")[0] for line in case.not_checked if "no particle can be compared" in line}
    assert judged.keys() | (open_ if label == "few" else set()) == expected
    for field, verdict in judged.items():
        coarse = label == "few" and verdict in PASSING  # three digits may hide what the finding does
        assert verdict == FOUND[name][1].get(field, verdict if verdict in PASSING else "pass") or coarse, field
    steps = sorted({check.step for check in case.checks})
    assert steps[0] == 0 and len(steps) >= 3 and case.blame is None


@pytest.mark.parametrize("label", ["scaled", "unwrapped"])
@pytest.mark.parametrize("name", ["box", "walls_quintic"])
def test_positions_in_other_forms(name: str, label: str, written: Decks) -> None:
    case, plain = (written(name).case(f"{form}.dump") for form in (label, "fifteen"))
    known = {field: verdict for field, verdict in verdicts(plain).items() if verdict == "explained"}
    assert verdicts(case).keys() == verdicts(plain).keys()
    assert {field: verdict for field, verdict in verdicts(case).items() if verdict not in PASSING} == known
    assert [check.step for check in case.checks] == [check.step for check in plain.checks]


def test_unwrapped_positions_may_lie_several_edges_away(box: Written) -> None:
    lines = [line.split() for line in (box.folder / "unwrapped.dump").read_text().splitlines()]
    rows = [words for words in lines if len(words) == len(headers("box")) and words[0].isdigit()]
    assert len(rows) == 3 * 125
    for words in rows[::2]:
        words[2] = repr(float(words[2]) + 3 * 5.0)  # edges of the box
    (box.folder / "far.dump").write_text("".join(" ".join(words) + "\n" for words in lines))
    assert verdicts(box.case("far.dump")) == verdicts(box.case("unwrapped.dump"))


def test_packed_and_binary_dumps_equal_text(box: Written) -> None:
    (box.folder / "fifteen.dump.gz").write_bytes(gzip.compress((box.folder / "fifteen.dump").read_bytes()))
    assert verdicts(box.case("fifteen.dump.gz")) == verdicts(box.case("fifteen.dump"))
    first, second = ([field.model_dump() for field in box.case(f"all.{kind}").fields] for kind in ("bin", "dump"))
    assert first == second and len(first) >= 9


@pytest.mark.parametrize("name", ["all.bin", "six.dump"])
def test_complete_snapshots_of_a_truncated_dump_are_judged(name: str, box: Written) -> None:
    content, cut, steps = (box.folder / name).read_bytes(), box.folder / f"cut.{name}", set()
    for share in (0.3, 0.5, 0.66, 0.67, 0.9, 0.999):
        cut.write_bytes(content[: int(share * len(content))])
        if share < 1 / 3:
            with pytest.raises(InputError, match="must end with a whole snapshot, found "):
                box.case(cut.name)
            continue
        case = box.case(cut.name)
        judged = sorted({check.step for check in case.checks})
        assert judged == [0, 5][: int(3 * share)]
        (warning,) = case.warnings
        assert warning.startswith(f"the dump is cut off after step {judged[-1]}: not judged is the rest, ")
        assert f"of 125 atoms of step {judged[-1] + 5}" in warning or "a part of a header" in warning
        steps.add(judged[-1])
    assert steps == {0, 5}


def test_bounds_follow_the_printed_digits(box: Written) -> None:
    """The largest difference of each format comes near its bound, and bounds shrink with more digits."""
    cases = (box.case(f"{label}.dump") for label in ("six", "fifteen"))
    six, fifteen = (next(f for f in case.fields if f.field == "pressure") for case in cases)
    assert all(0.3 < (field.max_over_bound or 0) <= 1 for field in (six, fifteen))
    assert (six.bound or 0) > 1e7 * (fifteen.bound or 1)


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
# Columns of the state, and the field that shows a change.
DEPENDENT = [
    *(("box", column, "all", "grad/v") for column in ("x", "vx", "fx")),
    *(("box", "rho", "all", "pressure"), ("power", "energy", "all", "temperature")),
    *(("box", "x", label, "grad/v") for label in ("scaled", "unwrapped")),
]  # fmt: skip


def grown(by: float) -> Callable[[str], str]:
    return lambda text: repr(float(text) * (1 + by) + by)


@pytest.mark.parametrize(("frame", "label", "by"), [(2, "all", 1e-6), (0, "six", 1e-1)])
@pytest.mark.parametrize(("name", "field"), [(name, field) for name, of in DIRECT.items() for field in of])
def test_planted_column_is_detected(
    name: str, field: str, label: str, by: float, frame: int, written: Decks, tmp_path: Path
) -> None:
    copy, words = written(name).edited(f"{label}.dump", tmp_path, frame, field, grown(by))
    result = written(name).audit(copy)
    bad = [check for check in case_of(result).checks if check.verdict == "differs" and check.field == field]
    assert [check.step for check in bad] == [5 * frame] == [int(result.arrays["step"])]
    assert field in KNOWN or bad[0].worst_id == int(words[0])  # a known difference of other atoms may be larger


@pytest.mark.parametrize(("name", "column", "label", "shows"), DEPENDENT)
def test_planted_state_is_detected_by_dependent_fields(
    name: str, column: str, label: str, shows: str, written: Decks, tmp_path: Path
) -> None:
    copy, _ = written(name).edited(f"{label}.dump", tmp_path, 2, column, grown(1e-4))
    bad = [check for check in written(name).case(copy).checks if check.verdict == "differs" and check.field == shows]
    assert [check.step for check in bad] == [10]


# --- numbers that are not finite, or very small: never PASS, never a traceback

IN_POWER = ["id", "type", *PLACES.split()[2:], "drho", "phase", "rho", "pressure", "grad/v", "temperature"]


@pytest.mark.parametrize("text", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("column", IN_POWER)
def test_non_finite_number_never_passes(column: str, text: str, written: Decks, tmp_path: Path) -> None:
    power = written("power")
    copy, words = power.edited("all.dump", tmp_path, 2, column, text)
    if column in ("id", "type"):
        with pytest.raises(InputError, match=rf"{column}: .*{text}"):
            power.case(copy)
        return
    case = power.case(copy)
    assert case.verdict == worst(["error", *verdicts(case).values()]) and case.broke is not None
    assert (case.broke.step, case.broke.column, case.broke.atom) == (10, words[-1], int(words[0]))
    assert str(case.broke.value) == text and (case.broke.particles, case.broke.of) == (1, 64)


@pytest.mark.parametrize("column", [name for name in IN_POWER[2:] if name != "phase"])  # which is 0 or not
def test_subnormal_number_is_compared_as_zero(column: str, written: Decks, tmp_path: Path) -> None:
    def judged(text: str) -> dict[str, Verdict]:
        return verdicts(written("power").case(written("power").edited("all.dump", tmp_path, 2, column, text)[0]))

    assert judged("5e-324") == judged("1e-310") == judged("0")


@pytest.mark.parametrize(
    ("column", "text", "reason"),
    [
        ("x", "nan", "grad/v: positions are not numbers (steps 0)"),
        ("x", "1e300", "grad/v: positions are not known to within the cutoff (steps 0)"),
        ("vx", "nan", "particles cannot be compared, by the digits"),
        ("rho", "inf", "pressure: 1 of 125 particles cannot be compared, by the digits"),
    ],
)
def test_particles_without_number_are_excluded(
    column: str, text: str, reason: str, box: Written, tmp_path: Path
) -> None:
    case = box.case(box.edited("all.dump", tmp_path, 0, column, lambda _: text)[0])
    assert any(reason in line for line in case.not_checked), case.not_checked
    assert {check.field for check in case.checks if check.step == 0} >= {"viscosity", "pressure"}
    assert (case.broke is None) == (text == "1e300")


# --- what is not checked, and why


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
    (folder / dump.name).write_text("\n".join(lines) + "\n")
    return folder / dump.name


@pytest.mark.parametrize(
    ("keep", "compared", "at_first", "reason"),
    [
        ("rho pressure", {"pressure"}, set(), "f: no columns fx fy fz in the dump"),
        ("x y z rho coordination", {"coordination"}, set(), "pressure: no column of it in the dump (compute rheo/"),
        ("rho coordination pressure", {"pressure"}, set(), "coordination: the dump lacks columns x y z"),
        ("grad/v viscosity stress/v", {"viscosity", "stress/v"}, set(), "grad/v: the dump lacks columns x y z, rho,"),
        ("x y z vx vy vz rho grad/v", set(), {"grad/v"}, "grad/v: the dump lacks a column of drho (compute property"),
        ("x y z vx vy vz rho grad/v drho", {"drho"}, {"grad/v"}, "columns fx fy fz, as the forces saw the state half"),
        ("x y z", set(), set(), ""),
    ],
)  # fmt: skip
def test_fields_with_missing_columns_are_not_checked(
    keep: str, compared: set[str], at_first: set[str], reason: str, box: Written, tmp_path: Path
) -> None:
    copy = cut(box.folder / "all.dump", ["id", "type", *keep.split()], "box", tmp_path)
    columns = next(line for line in copy.read_text().splitlines() if line.startswith("ITEM: ATOMS")).split()[2:]
    setups = box.dumping("all", lambda words, modify: ([*words[:5], *columns], modify))
    if not compared | at_first:
        with pytest.raises(InputError, match=r"against each other; it lacks .*: see compute rheo/property/atom"):
            box.case(copy, setups=setups)
        return
    case = box.case(copy, setups=setups)
    assert {check.field for check in case.checks} == compared | at_first
    assert {check.field for check in case.checks if check.step > 0} == compared
    assert all(check.verdict in PASSING for check in case.checks)
    assert any(reason in line for line in case.not_checked), case.not_checked
    assert all("(steps 5, 10)" in line for line in case.not_checked if line.partition(":")[0] in at_first)


LOCAL = {"pressure", "viscosity", "stress/v", "stress/t"}


@pytest.mark.parametrize(
    ("group", "modify", "word"), [("half", (), "group half"), ("all", ("thresh", "x", "<", "2"), "thresh")]
)
def test_sums_need_all_particles(group: str, modify: Sequence[str], word: str, box: Written) -> None:
    setups = box.dumping("all", lambda words, more: ([words[0], group, *words[2:]], [*more, *modify]))
    case = box.case("all.dump", setups=setups)
    assert {check.field for check in case.checks} == LOCAL
    assert any(line.startswith("f: the dump holds") and word in line for line in case.not_checked)


def test_fixes_moving_particles_after_the_forces(box: Written) -> None:
    fixes = {"9": ["fix", "9", "all", "momentum", "1", "linear", "1", "1", "1"]}
    runs = [replace(run, deck=replace(run.deck, fixes=run.deck.fixes | fixes)) for run in box.setups.runs]
    case = box.case("all.dump", setups=replace(box.setups, runs=runs))
    assert {check.field for check in case.checks if check.step} == LOCAL
    assert any("fix 9 (momentum) may move particles" in line for line in case.not_checked)


def test_renamed_columns_and_chosen_fields(box: Written) -> None:
    assert verdicts(box.case("all.dump", "pressure", "drho")).keys() == {"pressure", "drho"}
    setups = box.dumping("all", lambda words, modify: (words, [*modify, "colname", "c_of_audit[3]", "P"]))
    (box.folder / "renamed.dump").write_text((box.folder / "all.dump").read_text().replace("c_of_audit[3]", "P"))
    assert "pressure" in verdicts(box.case("renamed.dump", setups=setups))


# --- restart files


def restarted(box: Written, deck: Path) -> CaseRecord:
    return case_of(command.audit_restart(box.folder / "kept.5", deck, AuditOptions()))


def test_restart_is_judged_by_field(box: Written) -> None:
    case = restarted(box, box.folder / "in.deck")
    assert case.case == "kept.5" and {check.step for check in case.checks} == {5}
    assert set(verdicts(case).values()) <= {*PASSING, "explained"}
    assert {"pressure", "grad/v", "shift/v", "f"} <= verdicts(case).keys()


def test_restart_uses_fixes_of_its_run(box: Written, tmp_path: Path) -> None:
    """A law defined for a later run does not apply to the restart file of an earlier one."""
    later = "unfix 3\nfix 3 all rheo/pressure * linear\nrun 5\n"
    (tmp_path / "in.deck").write_text((box.folder / "in.deck").read_text() + later)
    shutil.copy(box.folder / "kept.5", tmp_path)
    assert [law.style for law in restarted(box, tmp_path / "in.deck").laws] == ["cubic"]


# --- bad input

ROW = re.compile(r"(?<=\n)1 1 ")
# Options after `audit`, files made of the whole dump, and the message.
BAD: list[tuple[str, Callable[[str], str | bytes] | None, str]] = [
    ("--dump all.dump", None, "deck: must be given once"),
    ("in.deck --deck in.deck", None, "deck: must be given once"),
    ("in.deck --dump all.dump --restart kept.5", None, "restart"),
    ("in.deck --dump none.dump", None, "file: cannot be read: No such file"),
    ("in.deck --dump in.deck", None, "must be one of text"),
    ("in.deck --dump cut.dump", lambda whole: whole[:2000], "must end with a whole snapshot"),
    ("in.deck --dump empty.dump", lambda whole: "", "must hold a snapshot"),
    ("in.deck --dump all.nc", lambda whole: b"CDF\x02\0\0\0\0",
     "dump: must be of dump custom, not of dump netcdf: OVITO converts it"),
    ("in.deck --dump cut.dump.gz", lambda whole: gzip.compress(whole.encode())[:99],
     "dump: cannot be unpacked by gzip"),
    ("in.deck --dump late.dump", lambda whole: whole.replace("TIMESTEP\n10\n", "TIMESTEP\n99\n"),
     "must be one of the runs of the deck that write it (steps 0 to 10)"),
    ("in.deck --dump other.dump", lambda whole: whole.replace("c_rates", "c_other"),
     "must be those that a dump of the deck writes: id type x"),
    ("in.deck --dump noid.dump", lambda whole: whole.replace("ATOMS id", "ATOMS mol"), "must hold id"),
    ("in.deck --dump word.dump", lambda whole: re.sub(r"(ITEM: ATOMS.*\n\d+ \d+) \S+", r"\1 much", whole),
     "must hold numbers"),
    ("in.deck --dump types.dump", lambda whole: ROW.sub("1 9 ", whole),
     "type: must lie within 1 to 1, found 9 (types.dump, step 0)"),
    ("in.deck --dump twice.dump", lambda whole: ROW.sub("2 1 ", whole),
     "id: must differ from particle to particle (twice.dump, step 0)"),
    ("in.nothing --dump all.dump", None, "deck: no such file"),
    ("in.deck --restart none", None, "restart: must be a readable file"),
    ("in.deck --restart all.dump", None, "restart: must be readable by LAMMPS"),
    ("in.short --restart kept.10", None, "step: must be one of the deck's runs (steps 0 to 2)"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "made", "message"), BAD, ids=[words for words, _, _ in BAD])
def test_bad_input_gives_a_one_line_message(
    words: str, made: Any, message: str, box: Written, eos_ref_command: Callable[..., Outcome],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    if made:
        content = made((box.folder / "all.dump").read_text())
        (box.folder / words.split()[-1]).write_bytes(content if isinstance(content, bytes) else content.encode())
    (box.folder / "in.short").write_text((box.folder / "in.deck").read_text().replace("run             10", "run 2"))
    monkeypatch.chdir(box.folder)
    if "in.deck" in words:
        monkeypatch.setattr(finished, "described", lambda *_: (Findings(who=box.who), box.setups))
    code, _, complaint = eos_ref_command("audit", *words.split(), "--out", "report")
    assert (code, complaint.count("\n")) == (2, 1) and message in complaint, complaint
    assert not (box.folder / "report").exists()


def test_command_reports_a_number_that_is_not_finite(
    box: Written, tmp_path: Path, eos_ref_command: Callable[..., Outcome]
) -> None:
    copy, words = box.edited("all.dump", tmp_path, 2, "vx", "nan")
    code, out, _ = eos_ref_command("audit", box.folder / "in.deck", "--dump", copy, "--out", tmp_path / "out")
    assert code != 0 and "PASS" not in out and all(word in out for word in ("10", words[0], "vx"))


def test_deck_without_a_model_leaves_nothing_to_check(box: Written) -> None:
    runs = [
        replace(run, deck=replace(run.deck, fixes={k: w for k, w in run.deck.fixes.items() if w[3][5:] != "viscosity"}))
        for run in box.setups.runs
    ]
    with pytest.raises(InputError, match=r"against each other; \w+: .*viscosity.*all\.dump"):
        box.case("all.dump", setups=replace(box.setups, runs=runs))
