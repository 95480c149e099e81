"""How decks start: switches of LAMMPS' command line, where a deck runs, and decks that an audit refuses."""

from __future__ import annotations

import json
import math
import shlex
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from eos_ref import InputError, audit
from lammps_cases.audit import command, place, supervise, text
from lammps_cases.audit.fields import PRESSURE
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.place import DeckPlace
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.cli.audit import _taken
from lammps_cases.records.run_record import CaseRecord, read_run
from tests.support.audited_decks import DECKS, FIXES, MELT, case_of, write_deck
from tests.support.outcome import Outcome

STARTED = ("-var", "cells", "6", "-var", "eta", "0.2")


# --- switches


@pytest.mark.parametrize(
    ("words", "var", "package", "rest"),
    [
        ("in.x -var n 12 -var v 0.1", {"n": ("12",), "v": ("0.1",)}, (), "in.x"),
        ("-var a 1 2 b --every 5 in.x", {"a": ("1", "2", "b")}, (), "--every 5 in.x"),
        ("-v a -1 2 -in in.x", {"a": ("-1", "2")}, (), "-in in.x"),
        ("-pk omp 4 neigh yes -package gpu 0 -sf kk", {}, ("omp 4 neigh yes", "gpu 0"), "-sf kk"),
        ("-log none -l x -screen none -sc x -echo both -e log -nocite -nc -nb -nonbuf -cite a -c b i", {}, (), "i"),
        ("-k off in.x -plog none -pscreen none", {}, (), "in.x"),
        ("--var x", {}, (), "--var x"),
    ],
)
def test_switches(words: str, var: dict[str, Sequence[str]], package: tuple[str, ...], rest: str) -> None:
    assert _taken(words.split()) == (var, package, rest.split())


CANNOT = "cannot be used in an audit"
SWITCHES = f"""
-k on g 1 | switch -k: {CANNOT}: RHEO has no styles of KOKKOS
-kokkos on | switch -kokkos: cannot be used
-partition 2x1 | switch -partition: {CANNOT}: an audit follows one partition
-p 2x1 | switch -p: cannot be used
-mdi flags | switch -mdi: {CANNOT}: another program would drive LAMMPS
-skiprun | switch -skiprun: {CANNOT}: without steps there is nothing to check
-sr | switch -sr: cannot be used
-plugin x.so | switch -plugin: {CANNOT}: no audit loads libraries
-reorder nth 2 | switch -reorder: cannot be used
-r2data a b | switch -r2data: {CANNOT}: it converts a file and runs no deck
-restart2info a | switch -restart2info: cannot be used
-var n | switch -var: must be given as -var NAME VALUE...
-pk | switch -pk: must be given as -pk STYLE ARGUMENT...
-log | switch -log: must be given as -log WORD
-var n-1 2 | var: must be a name of letters, digits and _, and at least one value, found 'n-1'
-in in.y | deck: must be given once
"""


@pytest.mark.parametrize("row", SWITCHES.strip().splitlines())
def test_bad_switches_are_refused(row: str, eos_ref_command: Callable[..., Outcome], tmp_path: Path) -> None:
    words, message = row.split(" | ")
    deck = tmp_path / "in.x"
    deck.write_text("print ${m}\n")
    outcome = eos_ref_command("audit", deck, *words.split(), "--out", tmp_path / "out")
    assert (outcome.code, outcome.err.count("\n")) == (2, 1) and message in outcome.err
    assert not (tmp_path / "out").exists()


def test_values_of_var_may_contain_the_deck(eos_ref_command: Callable[..., Outcome]) -> None:
    outcome = eos_ref_command("audit", "-var", "n", "12", "in.x")
    assert outcome.code == 2 and "deck: must be given once before -var" in outcome.err


def test_options_become_words_of_the_command_line() -> None:
    options = AuditOptions.of(
        every=5, timeout=float("inf"), fields="rho, pressure", suffix="kk", package=["omp 4"], root="a b",
        var={"n": 12, "text": "a b", "many": (1, 2)}, ranks=4, budgets=True, engine="/site",
    )  # fmt: skip
    words = options.words()
    assert shlex.join(words) == (
        "--every 5 --timeout inf --engine path:/site --fields rho,pressure -sf kk -pk omp 4 -var n 12 "
        "-var text 'a b' -var many 1 2 --root 'a b' --ranks 4 --budgets"
    )
    var, package, _ = _taken(words)
    assert (var, package) == (options.var, options.package)
    assert options.commands() == [
        "suffix kk", "package omp 4", "variable n index 12", 'variable text index """a b"""', "variable many index 1 2",
    ]  # fmt: skip
    assert AuditOptions(trust=False).words() == []


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"evry": 5}, "argument evry: Unexpected keyword argument"),
        ({"every": "x"}, "argument every: Input should be a valid integer"),
        ({"every": 0}, "every: must be 1 to 2147483647 time steps"),
        ({"steps": 0}, "steps: must be at least 1"),
        ({"timeout": 0.0}, "timeout: must be a positive"),
        ({"timeout": math.nan}, "timeout: must be a positive"),
        ({"fields": "nonsense"}, "field: must be one of all, "),
        ({"var": {"a b": 1}}, "var: must be a name of letters"),
        ({"var": {"a": ()}}, "var: must be a name of letters"),
    ],
)
def test_wrong_options_of_the_function(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as raised:
        AuditOptions.of(**wrong)
    assert str(raised.value).startswith(message)


@pytest.mark.lammps
def test_deck_with_variables(eos_ref_command: Callable[..., Outcome], tmp_path: Path) -> None:
    outcome = eos_ref_command("audit", "-in", DECKS / "in.started", "-log", "none", *STARTED, "--out", tmp_path / "a")
    assert "5 steps, 36 atoms" in outcome.out
    run = read_run(tmp_path / "a")
    assert run.cases[0].reproduce == shlex.join(["eos-ref", "audit", str(DECKS / "in.started"), *STARTED])
    assert shlex.join(STARTED) in run.command
    refused = eos_ref_command("audit", DECKS / "in.started", *STARTED[:3], "--out", tmp_path / "b", "--json")
    (case,) = json.loads(refused.out)["cases"]
    assert case["verdict"] == "refused"
    assert "Substitution for illegal variable eta" in case["message"] and "-var eta VALUE" in case["message"]


@pytest.mark.lammps
def test_variables_are_index_variables_of_the_command_line(tmp_path: Path) -> None:
    """They override the deck's definition, words may contain anything, and the first of several values is used."""
    deck = write_deck(tmp_path, "variable n index 9\nprint '${n}|${text}|${many}' file out.txt\nrun 0\n")
    var = {"n": "-3", "text": "a # $x", "many": (1, 2)}
    audit_deck(deck, AuditOptions(var=var, keep=tmp_path / "kept", fields=PRESSURE))
    assert (tmp_path / "kept" / "out.txt").read_text() == "-3|a # $x|1\n"


# --- where a deck runs


@pytest.fixture
def project(tmp_path: Path) -> Path:
    shutil.copytree(DECKS / "project", tmp_path / "project")
    return tmp_path / "project"


@pytest.mark.parametrize(
    ("current", "deck", "root", "expected"),
    [
        (".", "decks/in.tank", None, (".", ".")),
        ("decks", "in.tank", None, ("decks", "decks")),  # nothing that it reads lies there
        ("decks", "in.above", None, ("decks", "decks")),
        ("decks", "in.above", "..", (".", "decks")),
        (".", "decks/in.above", ".", (".", "decks")),
        (".", "decks/in.tank", ".", (".", ".")),
        ("data", "../decks/in.tank", "..", (".", ".")),
        ("data", "../decks/in.beside", None, ("data", "data")),  # of a deck elsewhere
        ("data", "../decks/in.own", None, ("decks", "decks")),
        (".", "decks/in.nothing", None, ("decks", "decks")),
        (".", "decks/in.branch", None, (".", ".")),
        *((".", f"decks/in.{name}", None, (".", ".")) for name in ("named", "given -var d data/water", "included")),
        (".", "decks/in.given", None, ("decks", "decks")),
    ],
)
def test_where_a_deck_runs(
    current: str, deck: str, root: str | None, expected: tuple[str, str], project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, content in {
        "beside": "read_data water.data\n",
        "own": "include own.inc\nread_data water.data\n",
        "nothing": "run 0\nread_restart made.later\n",
        "branch": "if '1 > 0' then 'read_data data/water.data'\n",
        "named": "variable d index data/water\nread_data ${d}.data\n",
        "given": "variable d index none\nread_data ${d}.data\n",
        "included": "include common/named.inc\nread_data $d\n",
    }.items():
        (project / "decks" / f"in.{name}").write_text(content)
    (project / "decks" / "own.inc").write_text("\n")
    (project / "common" / "named.inc").write_text("variable d string data/water.data\n")
    monkeypatch.chdir(project / current)
    deck, _, var = deck.partition(" -var d ")
    found = place.find(Path(deck), None if root is None else Path(root), {"d": (var,)} if var else {})
    assert (found.root, found.working) == tuple((project / each).resolve() for each in expected)


@pytest.mark.parametrize("root", ["data", "none", "data/water.data"])
def test_root_must_contain_the_deck(root: str, project: Path) -> None:
    with pytest.raises(InputError, match="root: must be a folder that holds the deck"):
        place.find(project / "decks" / "in.tank", project / root, {})


@pytest.mark.parametrize(
    ("content", "typed", "place_"),
    [
        ("include ../common/fluid.inc\n", "--root .., to copy that folder, or --trust", "in.x:1"),
        ("print a\nread_data ../../water.data\n", "--root ../.., to copy that folder, or --trust", "in.x:2"),
        ("include ../common/a.inc\nread_data ../../w.data\n", "--root ../.., to copy", "in.x:1"),
        ("variable d string ../data\nread_data ${d}/water.data\n", "--root .., to copy", "in.x:2"),
        ("molecule m ../m.mol\n", "--root .., to copy", "in.x:1"),
        ("if '0 > 1' then 'jump ../in.y'\n", "--root .., to copy", "in.x:1"),
        ("dump 1 all atom 1 ../out.dump\n", "--root .., to copy", "in.x:1"),
        ("include /common/fluid.inc\n", "type --trust", "in.x:1"),
        ("read_data ../../../../../../../../../../w.data\n", "type --trust", "in.x:1"),
    ],
)
def test_paths_out_of_the_copy_are_refused(
    content: str, typed: str, place_: str, project: Path, monkeypatch: pytest.MonkeyPatch,
    eos_ref_command: Callable[..., Outcome],
) -> None:  # fmt: skip
    monkeypatch.chdir(project / "decks")
    Path("in.x").write_text(content)
    outcome = eos_ref_command("audit", "in.x", "--out", project / "out")
    assert (outcome.code, outcome.err.count("\n")) == (2, 1)
    assert "must not leave the folder that is copied" in outcome.err and typed in outcome.err and place_ in outcome.err


def test_suggested_command_works_when_typed(project: Path) -> None:
    deck, decks = project / "decks" / "in.above", project / "decks"
    with pytest.raises(InputError, match="must not leave"):
        place.check_script(deck, DeckPlace(decks, decks))
    place.check_script(deck, DeckPlace(project, decks))


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("current", "words", "made"),
    [
        (".", ("decks/in.tank",), True),
        ("data", ("../decks/in.tank", "--root", ".."), True),
        ("decks", ("in.above", "--root", ".."), False),
        ("decks", ("in.above", "--trust"), False),
        (".", ("decks/in.above", "--trust"), False),
    ],
)
def test_decks_of_a_project(
    current: str, words: Sequence[str], made: bool, project: Path, monkeypatch: pytest.MonkeyPatch,
    eos_ref_command: Callable[..., Outcome],
) -> None:  # fmt: skip
    monkeypatch.chdir(project / current)
    before = sorted(project.rglob("*"))
    outcome = eos_ref_command("audit", *words, "--fields", "pressure", "--out", project.parent / "out")
    assert "5 steps, 36 atoms" in outcome.out, outcome
    assert ("warning: folder out does not exist: made in the copy" in outcome.out) == made
    assert sorted(project.rglob("*")) == before
    reproduce = read_run(project.parent / "out").cases[0].reproduce
    assert sorted(shlex.split(reproduce)) == sorted(["eos-ref", "audit", *words, "--fields", "pressure"])


@pytest.mark.lammps
def test_deck_from_another_folder_runs_in_the_current_one(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project / "data")
    shutil.copy(project / "common" / "fluid.inc", ".")
    content = (project / "decks" / "in.above").read_text()
    (project / "decks" / "in.beside").write_text(content.replace("../common/", "").replace("${data}/", ""))
    result = audit("../decks/in.beside", fields="pressure", out=project.parent / "out")
    assert result.record.cases[0].steps == 5


@pytest.mark.lammps
def test_restart_of_a_project(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project)
    deck, kept = project / "decks" / "in.tank", project.parent / "kept"
    deck.write_text(deck.read_text().replace("run  ", "restart 5 kept.*\nrun  "))
    audit_deck(deck, AuditOptions(keep=kept, fields=PRESSURE))
    case = case_of(command.audit_restart(kept / "kept.5", deck, AuditOptions(fields=PRESSURE)))
    assert {check.step for check in case.checks} == {5}


def test_folders_next_to_the_copy_are_links(tmp_path: Path) -> None:
    for name in ("a/b/c", "a/other", "x"):
        (tmp_path / "disk" / name).mkdir(parents=True)
    source = (tmp_path / "disk" / "a" / "b").resolve()
    (tmp_path / "target").mkdir()
    copy = place.nested_folder(source, tmp_path / "target")
    assert copy == tmp_path / "target" / source.relative_to("/") and not list(copy.iterdir())
    assert (copy / ".." / "other").resolve() == source.parent / "other"
    assert (copy / ".." / ".." / "x").resolve() == source.parents[1] / "x"


# --- commands that are refused

OUTSIDE = """
shell rm -rf .
python f here 'x = 1'
plugin load evil.so
variable x python f
fix 1 all python/invoke 10 end_of_step f
pair_style hybrid/overlay rheo 3.0 python 2.5
if '1 > 0' then 'print a' else "shell ls"
run 100 every 10 'shell ls'
partition yes 1 shell ls
log /elsewhere/log.lammps
dump 1 all atom 10 ../out.dump
write_data sub/../../x.data
read_data ../common/fluid.data
include ../settings.inc
jump /elsewhere/in.deck
molecule m sub/../../m.mol
pair_coeff * * ../table.txt
variable f file ../names
if '1 > 0' then 'include ../settings.inc'
print 'x' file /elsewhere/x
write_dump all atom 'a;touch b;.gz'
dump 1 all custom 10 out.*.gz id x
dump 1 all movie 10 m.mp4 type type
   'shell' ls # quoted
"""
INSIDE = """
# shell ls
print 'shell ls'
print '/elsewhere'
variable a equal 1 / 2
jump SELF ../label
variable a string /elsewhere
dump 1 all atom/gz 10 out.*.gz
dump 1 all custom 10 sub/../out.dump id x
label shell
thermo_style custom step temp
fix 3 all rheo/pressure * linear
group python type 1
if '1 > 0' then 'print shell'
"""


@pytest.mark.parametrize("command", [*OUTSIDE.strip("\n").split("\n"), *INSIDE.strip("\n").split("\n")])
def test_commands_that_reach_outside(command: str) -> None:
    words = text.words(text.without_comment(command))
    if command in INSIDE.split("\n"):
        place.check_command(words, "here", DeckPlace())
        return
    with pytest.raises(InputError):
        place.check_command(words, "here", DeckPlace())


def test_included_files_are_checked(tmp_path: Path) -> None:
    deck = tmp_path / "in.deck"
    deck.write_text("if '0 > 1' then 'include a.inc'\n")
    (tmp_path / "a.inc").write_text("jump b.inc\njump SELF\n")
    (tmp_path / "b.inc").write_text("\nprint &\n  x\nshell ls\ninclude a.inc\n")
    with pytest.raises(InputError, match=r"shell.*b\.inc:4"):
        audit_deck(deck, AuditOptions(trust=False))


def test_shell_is_refused_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"command shell: not allowed in an audit.*in\.shell:2"):
        audit_deck(DECKS / "in.shell", AuditOptions(keep=tmp_path, trust=False))
    assert not list(tmp_path.iterdir())


@pytest.mark.lammps
@pytest.mark.slow
def test_shell_made_of_variables_is_refused_unless_allowed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From its text, whatever contains the process."""
    monkeypatch.setattr(supervise, "confined", lambda options: "none")
    with pytest.raises(InputError, match=r"'shell touch touched' \(in\.hidden_shell:6\)"):
        audit_deck(DECKS / "in.hidden_shell", AuditOptions(keep=tmp_path / "refused", trust=False))
    assert not (tmp_path / "refused" / "touched").exists()
    options = AuditOptions(keep=tmp_path / "allowed", trust=True, fields=PRESSURE)
    assert case_of(audit_deck(DECKS / "in.hidden_shell", options)).verdict == "refused"  # by LAMMPS, without fix rheo
    assert (tmp_path / "allowed" / "touched").exists()


# --- decks that cannot be checked, or that LAMMPS refuses


def audited(commands: str, folder: Path, trust: bool = True) -> CaseRecord:
    return case_of(audit_deck(write_deck(folder, commands), AuditOptions(trust=trust)))


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("commands", "rule"),
    [
        (FIXES, "must reach a run command"),
        (f"{FIXES}fix 3 all rheo/pressure * linear\nrun 9 every 3 'unfix 3'\n", "may not hold a command"),
        (f"{FIXES}variable c string fix\nrun 9 every 3 '${{c}} 3 all x'\n", "may not hold a command"),
        (f"{FIXES}variable c string log\npartition yes 1 clear\n", "may not hold a command"),
        (f"clear\n{MELT}", "must define fix rheo and fix rheo/pressure before a run"),
        ("variable up equal 1\nif '${up} == 1' then 'variable d string ..'\ninclude ${d}/a.inc\n",
         r"must not leave the folder that is copied.*in\.deck:5"),
    ],
)  # fmt: skip
def test_decks_that_cannot_be_checked(commands: str, rule: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rule):
        audited(commands, tmp_path, trust="copied" not in rule)


def test_missing_deck(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="deck: no such file"):
        audit_deck(tmp_path / "in.none")


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("commands", "message"),
    [
        *(
            (command, "ERROR")
            for command in ("include no.inc", "jump no.inc", "jump SELF nowhere", "if '1 >", "next z")
        ),
        ("foo \x1b[31mred\x07", r"Unknown command: foo \x1b[31mred\x07"),  # escaped
        ("print $\xe9", "Substitution for illegal variable \ufffd"),  # LAMMPS quotes one byte of it
    ],
)
def test_errors_of_lammps_are_refusals(commands: str, message: str, tmp_path: Path) -> None:
    deck = write_deck(tmp_path, "")
    deck.write_bytes(deck.read_bytes() + commands.encode("latin-1") + b"\n")
    case = case_of(audit_deck(deck))
    assert case.verdict == "refused" and case.message.startswith("ERROR")
    assert message in case.message and "in.deck:" in case.message
