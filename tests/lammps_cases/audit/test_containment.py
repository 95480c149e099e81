"""Untrusted decks on real LAMMPS: the process that runs them is contained, whatever the text of the deck."""

from __future__ import annotations

import functools
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from eos_ref import InputError
from lammps_cases.audit import place, supervise
from lammps_cases.audit.fields import PRESSURE
from lammps_cases.audit.messages import CommandPlace
from lammps_cases.audit.options import TRUST, AuditOptions, AuditTask
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.engine import containment, mpi
from lammps_cases.engine.session import package_directory
from tests.conftest import ROOT
from tests.support.audited_decks import DECKS, case_of
from tests.support.outcome import Outcome

pytestmark = pytest.mark.lammps

SECRET = "correct-horse-battery-staple"
BOX = (
    "region b block 0 4 0 4 0 4; lattice sc 1.0; create_box 1 b; create_atoms 1 box; mass 1 1; "
    "pair_style zero 1.5; pair_coeff * *"
)


def answers(monkeypatch: pytest.MonkeyPatch, deck: Path, entry: Callable[..., Any], keep: Path | None = None) -> Any:
    """Result of an entry function in the process of a deck, contained as for an audit."""
    monkeypatch.setattr(supervise, "ENTRY", functools.partial(_answered, entry))
    with pytest.raises(InputError) as raised:
        pytest.fail(case_of(audit_deck(deck, AuditOptions(trust=False, keep=keep))).message)
    return json.loads(str(raised.value.found))


def _answered(entry: Callable[[Any], Any], task: AuditTask, connection: Connection) -> None:
    from lammps_cases.audit import child

    os.chdir(task.folder)
    connection.send(InputError("answer", "found", json.dumps(entry(child.start(task)[0]))))


def _commands(commands: list[str], lmp: Any) -> list[str]:
    for command in BOX.split("; "):
        lmp.command(command)
    found = []
    for command in commands:
        try:
            lmp.command(command)
            found.append("")
        except Exception as error:
            found.append(str(error))
    return found


def _calls(outside: str, lmp: Any) -> dict[str, str]:
    """Calls that code loaded by a deck could try: the error of each, empty if it succeeds."""
    import signal
    import socket
    import tempfile
    import threading

    library = Path(package_directory()) / "liblammps.so"
    calls: dict[str, Callable[[], Any]] = {
        "read": lambda: Path(outside, "secret").read_text(),
        "list": lambda: list(Path(outside).iterdir()),
        "passwords": lambda: Path("/etc/passwd").read_text(),
        "environment of others": lambda: Path(f"/proc/{os.getppid()}/environ").read_bytes(),
        "write": lambda: Path(outside, "made").write_text("x"),
        "truncate": lambda: os.truncate(Path(outside, "secret"), 0),
        "remove": lambda: Path(outside, "secret").unlink(),
        "change mode": lambda: Path(outside, "secret").chmod(0o777),
        "link": lambda: os.link(Path(outside, "secret"), "taken"),
        "symbolic link": lambda: Path("taken").symlink_to(Path(outside, "secret")),
        "fifo": lambda: os.mkfifo("pipe"),
        "shared memory": lambda: Path("/dev/shm/eos-ref-test").write_text("x"),
        "cache": lambda: Path(os.environ["XDG_CACHE_HOME"], "eos-ref", "made").write_text("x"),
        "engine": lambda: library.open("ab").close(),
        "fork": os.fork,
        "program": lambda: os.execv("/bin/true", ["true"]),
        "shell": lambda: subprocess.run("true", shell=True, check=True),
        "internet": lambda: socket.create_connection(("127.0.0.1", 9)),
        "datagram": lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM),
        "local socket": lambda: socket.socket(socket.AF_UNIX),
        "signal": lambda: os.kill(os.getppid(), signal.SIGTERM),
        # allowed calls
        "own file": lambda: Path("made").write_text("x"),
        "own folder": lambda: shutil.rmtree(tempfile.mkdtemp(dir=".")),
        "thread": lambda: threading.Thread(target=print).start(),
        "clock": time.time,
    }
    found = {}
    for name, call in calls.items():
        try:
            call()
            found[name] = ""
        except BaseException as error:
            found[name] = type(error).__name__
    return found


ALLOWED = {"own file", "own folder", "thread", "clock"}
# Calls on its own file system and processes.
WITHIN_BUBBLEWRAP = {"symbolic link", "fifo", "shared memory", "signal", "environment of others"}


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    folder = tmp_path / "outside"
    folder.mkdir()
    (folder / "secret").write_text(SECRET)
    return folder


@pytest.fixture
def deck(tmp_path: Path) -> Path:
    (tmp_path / "deck").mkdir()
    (tmp_path / "deck" / "in.deck").write_text("print ready\n")
    return tmp_path / "deck" / "in.deck"


MEANS = [means for means in ("landlock", "bubblewrap") if means in containment.available()]


@pytest.fixture(params=MEANS)
def means(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Each means of containment that this machine has."""
    monkeypatch.setattr(containment, "available", lambda: (request.param,))
    monkeypatch.setattr(containment, "SYSTEM", (*containment.SYSTEM, str(ROOT / "tests")))  # the entries
    return str(request.param)


def test_code_of_a_deck_reaches_nothing(outside: Path, deck: Path, means: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found = answers(monkeypatch, deck, functools.partial(_calls, str(outside)))
    allowed = ALLOWED | (WITHIN_BUBBLEWRAP if means == "bubblewrap" else set())
    assert {name for name, error in found.items() if not error} == allowed
    assert [file.name for file in outside.iterdir()] == ["secret"] and (outside / "secret").read_text() == SECRET


# Commands that the text of a deck may hide: LAMMPS turns typographic quotes and blanks into plain ones.
REACHING_OUT = [
    "shell touch {outside}/made",
    "\u200bshell touch {outside}/made",
    "shell\u00a0touch\u00a0{outside}/made",
    "shell rm {outside}/secret",
    "shell mkdir {outside}/made",
    "shell mv {outside}/secret .",
    "log {outside}/made",
    "log \u2018{outside}/made\u2019",
    "print \u2018x\u2019 file {outside}/made",
    "print \u201cx\u201d append \u201c{outside}/secret\u201d",
    "write_data\u2009{outside}/made",
    "write_restart {outside}/made",
    "fix p all print 1 \u2018x\u2019 file {outside}/made",
    "fix t all ave/time 1 1 1 c_thermo_temp file \u201c{outside}/made\u201d",
    "include {outside}/secret",
    "include link",
    "jump {outside}/secret",
    "variable f file {outside}/secret",
    "variable a atomfile {outside}/secret",
    "read_data {outside}/secret add append",
    "molecule m {outside}/secret",
    "variable g getenv EOS_REF_SECRET",
    'print "${{g}}" file leak',
    "variable v file /proc/self/environ",
    "plugin load {outside}/secret",
    "dump e all custom 1 x.gz id",
    "dump d all atom 1 \u2018{outside}/made\u2019",
    "run 1",
    "write_dump all atom {outside}/made",  # last: LAMMPS crashes after a dump that it cannot write
]


def test_commands_of_a_deck_reach_nothing(
    outside: Path, deck: Path, means: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Given to LAMMPS directly, without the checks of the text."""
    monkeypatch.setenv("EOS_REF_SECRET", SECRET)
    (deck.parent / "link").symlink_to(outside / "secret")
    commands = [command.format(outside=outside) for command in REACHING_OUT]
    (outside / "secret").write_text(f"print {SECRET}\n{SECRET}\n")
    before = (outside / "secret").read_bytes()
    kept = tmp_path / "kept"
    assert SECRET not in str(answers(monkeypatch, deck, functools.partial(_commands, commands), kept))
    assert [file.name for file in outside.iterdir()] == ["secret"] and (outside / "secret").read_bytes() == before
    written = [file for file in kept.rglob("*") if file.is_file()]
    assert written and not any(SECRET.encode() in file.read_bytes() for file in written)


HIDDEN = [
    *("\u200bshell touch {outside}/made", "log \u2018{outside}/made\u2019", "include {outside}/secret", "include link"),
    *("variable s getenv EOS_REF_SECRET\nprint \u201c${{s}}\u201d\nfix ${{s}}", "jump {outside}/secret"),
    "variable s file {outside}/secret\nfix ${{s}}",
]


@pytest.mark.parametrize("command", HIDDEN)
def test_audit_of_a_hostile_deck_leaks_nothing(
    command: str, outside: Path, deck: Path, means: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("EOS_REF_SECRET", SECRET)
    (deck.parent / "link").symlink_to(outside / "secret")
    deck.write_text(command.format(outside=outside) + "\nrun 0\n")
    try:
        message = audit_deck(deck, AuditOptions(trust=False)).record.model_dump_json()
    except InputError as error:
        message = str(error)
    assert message and SECRET not in message and not (outside / "made").exists()


def test_deck_is_refused_without_containment(
    deck: Path, monkeypatch: pytest.MonkeyPatch, eos_ref_command: Callable[..., Outcome]
) -> None:
    monkeypatch.delenv(TRUST, raising=False)
    monkeypatch.setattr(containment, "landlock_version", lambda: 0)
    monkeypatch.setattr(shutil, "which", lambda program: None)
    refused = eos_ref_command("audit", deck, "--out", deck.parent / "out")
    assert refused.code == 2 and "deck: cannot be contained here" in refused.err and "--trust" in refused.err
    assert not (deck.parent / "out").exists()
    plain = DECKS / "in.plain"
    audited = eos_ref_command("audit", plain, "--trust", "--fields", "pressure", "--out", deck.parent / "out")
    assert "in.plain: exact" in audited.out
    monkeypatch.setenv(TRUST, "1")
    assert audit_deck(plain, AuditOptions(fields=PRESSURE)).record.exit_code() == 0


RANK = """
import sys
from lammps_cases.audit import child
from lammps_cases.audit.options import AuditOptions, AuditTask
lmp, _ = child.start(AuditTask("", sys.argv[1], AuditOptions(trust=False), sys.argv[3], sys.argv[2]))
for command in sys.argv[4].split("; "):
    lmp.command(command)
lmp.command(f"shell touch {sys.argv[2]}/made")
"""
STEPS = f"{BOX}; fix 1 all nve; velocity all create 1.0 1; comm_modify cutoff 2; run 20; variable n equal atoms"


@pytest.mark.parametrize("means", [means for means in MEANS if means == "landlock"])
@pytest.mark.parametrize("ranks", [1, 2])
def test_mpi_starts_in_a_contained_process(ranks: int, means: str, tmp_path: Path) -> None:
    (tmp_path / "copy").mkdir()
    (tmp_path / "tmp").mkdir()
    command, environment = mpi.launcher(package_directory().parent, ranks)
    commands = f"{STEPS}; print '${{n}} atoms' file atoms; info comm out append ranks"
    words = [sys.executable, "-c", RANK, str(tmp_path / "copy"), str(tmp_path), means, commands]
    environment |= {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "TMPDIR": str(tmp_path / "tmp")}
    given: dict[str, Any] = {"cwd": tmp_path / "copy", "capture_output": True, "text": True, "timeout": 120}
    done = subprocess.run([*command, *words], env=environment, check=False, **given)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "copy" / "atoms").read_text() == "64 atoms\n"
    assert f"Nprocs = {ranks}," in (tmp_path / "copy" / "ranks").read_text()
    assert not (tmp_path / "made").exists()


# --- endless decks, and texts that are not decks


@pytest.mark.parametrize(
    ("commands", "place"),
    [
        ("label a\njump SELF a\n", "in.deck:2"),
        ("variable i loop 1000000000\nlabel a\nprint x\nnext i\njump SELF a\n", "in.deck:"),
        (f"{BOX.replace('; ', chr(10))}\nfix 1 all nve\nrun 2000000000\n", "in.deck:9"),
    ],
    ids=["jump", "loop", "run"],
)
def test_endless_decks_are_stopped(commands: str, place: str, deck: Path) -> None:
    deck.write_text(commands)
    case = case_of(audit_deck(deck, AuditOptions(timeout=3.0)))  # within which a busy machine reads the first command
    assert case.verdict == "timeout" and case.message.startswith("stopped after 3 s") and place in case.message


@pytest.mark.parametrize(
    ("content", "rule"),
    [
        (b"print " + b"x" * 50_000_000, "must be at most 4 MiB"),
        (b"print " + b"x" * 3_000_000, "line: must be at most 32768 characters"),
        (b"print &\n" * 500_000, "line: must be at most 32768 characters"),
        (b'print """' + b"x\n" * 500_000, "line: must be at most 32768 characters"),
        (b"partition yes 1 " * 2000 + b"print x\n", "must not nest commands without end"),
        (b"include in.deck\n", "must not nest commands without end"),
        (b"if '1 > 0' then 'include in.deck'\n", "must not nest commands without end"),
        (b"\x00\xff\xfe" * 1000, ""),
        (b"'" * 30_000, ""),
        (b"include a\x00b\njump " + b"x" * 300 + b"\n", ""),
        (b'"""' * 10_000, ""),
    ],
    ids=range(11),
)
def test_any_text_gives_a_one_line_message(content: bytes, rule: str, deck: Path) -> None:
    deck.write_bytes(content)
    begin = time.monotonic()
    try:
        place.check_script(deck)  # not checked for a trusted deck
        message = case_of(audit_deck(deck, AuditOptions(timeout=60.0))).message
    except InputError as error:
        message = str(error)
    assert rule in message and "\n" not in message and len(message) < 1200
    assert time.monotonic() - begin < 20.0


def test_fifos_and_devices_are_refused(deck: Path) -> None:
    os.mkfifo(deck.parent / "fifo")
    (deck.parent / "zero").symlink_to("/dev/zero")
    deck.write_text("include fifo\n")
    assert "Cannot open input script fifo" in case_of(audit_deck(deck)).message
    for name in ("fifo", "zero"):
        with pytest.raises(InputError, match="must be a readable file"):
            audit_deck(deck.parent / name)


def test_limits_hold(deck: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of memory, and of the disk: half of the space that was free when the deck began."""
    monkeypatch.setattr(supervise, "ENTRY", _fills_memory)
    case = case_of(audit_deck(deck))
    assert case.verdict == "crashed" and "MemoryError" in case.message
    usage = iter([1000, 600, 499])
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=next(usage)))
    monkeypatch.setattr(supervise, "ENTRY", _sleeps)
    case = case_of(audit_deck(deck))
    assert case.verdict == "crashed" and "filled half of the disk" in case.message


def _fills_memory(task: AuditTask, connection: Connection) -> None:
    containment.limit(2**30, 60.0, 2**20)
    bytes(2**31)


def _sleeps(task: AuditTask, connection: Connection) -> None:
    time.sleep(600)


def _names_its_server(task: AuditTask, connection: Connection) -> None:
    watch = Path(f"/proc/{os.getppid()}/stat").read_text()
    connection.send(InputError("server", "is", watch.rpartition(")")[2].split()[1]))


def test_processes_of_decks_are_forks_of_one_server_that_may_die(deck: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervise, "ENTRY", _names_its_server)
    servers = list[int]()
    for _ in range(3):
        with pytest.raises(InputError) as named:
            audit_deck(deck)
        servers.append(int(str(named.value).split("'")[1]))
        if len(servers) == 2:
            os.kill(servers[1], signal.SIGKILL)
    assert servers[0] == servers[1] != servers[2]


# --- messages of a process that was taken over


class _Call:
    def __init__(self, function: Any, *arguments: Any) -> None:
        self.function, self.arguments = function, arguments

    def __reduce__(self) -> Any:
        return self.function, self.arguments


def _sends(content: Any, task: AuditTask, connection: Connection) -> None:
    connection.send_bytes(content if isinstance(content, bytes) else pickle.dumps(content))


@pytest.mark.parametrize(
    "content",
    [
        pickle.dumps(_Call(os.system, "touch made")),
        pickle.dumps(_Call(eval, "1")),
        pickle.dumps({"a": [_Call(getattr, AuditOptions, "__init__")]}),
        b"no pickle",
        b"",
        pickle.dumps(CommandPlace("a", "b"))[:-3],
        b"c" + b"lammps_cases.audit.options\nos\n.",
        b"\x80\x04\x8c\x1alammps_cases.audit.options\x8c\x10AuditOptions.any\x93.",
        b"\x80\x04]" + b"]a" * 10 + b"." + b"x" * 10,
        CommandPlace(1, b"\xff"),
        ["no message"],
    ],
    ids=range(11),
)
def test_messages_are_plain_data(content: Any, deck: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervise, "ENTRY", functools.partial(_sends, content))
    case = case_of(audit_deck(deck))
    assert case.verdict == "crashed", case.message
