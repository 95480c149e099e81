"""The command ``eos-ref``. Modules of the commands are imported when a command is run, so that --help is quick."""

from __future__ import annotations

import contextlib
import errno
import importlib
import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

# command: one line of help; the module of the same name, - as _, holds a click command, NAME_command
GROUPS = {
    "Everyday": {
        "run": "Run cases against LAMMPS and write a report: the main job.",
        "audit": "Check your input deck, run unmodified, while LAMMPS runs it.",
        "list": "List the cases.",
        "explain": "Show the purpose of a case, its laws and bounds, and what it models.",
        "ledger": "List the findings: where LAMMPS differs from its manual.",
        "report-bug": "Write a bug report for LAMMPS: a self-contained deck that prints PASS or FAIL, and the text.",
        "report": "Render the report of a finished run again.",
        "doctor": "Say what is installed, what works, and how to fix what does not.",
    },
    "Versions": {
        "compare": "Compare two engines, two runs, or a run and a baseline, field by field.",
        "bisect": "Name the first of several engines that changed.",
        "accept": "Accept a run as the baseline of its engine, with a reason.",
        "adopt": "Register a new LAMMPS version: which findings persist, disappear or appear.",
        "history": "Show how errors, times and verdicts changed from version to version.",
        "claims": "Check the manual's claims: which hold, on which engine, according to which cases.",
    },
    "Research": {
        "chart": "Chart speed against accuracy: LAMMPS, the reference, other methods.",
        "validate": "Run flows with experimental, numerical or analytic reference data.",
        "stability": "Map where methods fail, in LAMMPS and in the reference.",
        "examples": "Judge LAMMPS' own RHEO examples, and break down their errors.",
        "diagnose": "Group the red cases of a finished run, and say what could cause them.",
        "shrink": "Make the smallest scene that still fails the same way.",
    },
    "Maintenance": {
        "inputs": "Give bad input to LAMMPS and the reference: which refuses it, and how clearly.",
        "bench": "Measure speed relative to peers, as ratios.",
        "merge": "Join the shards of a run.",
        "kit": "Write the files that run this in a CI service, or in shards on a cluster.",
        "completion": "Print the script that lets the shell complete cases, tags, findings and engines.",
    },
}
PIPE_CLOSED = 141  # exit code, as shells have it of SIGPIPE
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # of a file, or of what the output is led into
COMMANDS = {name: text for commands in GROUPS.values() for name, text in commands.items()}


class LazyGroup(click.Group):
    """A group whose commands are imported on use."""

    def list_commands(self, context: click.Context) -> list[str]:
        """List the names in order of importance."""
        return list(COMMANDS)

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Import the module of a command."""
        if name not in COMMANDS:
            return None
        word = name.replace("-", "_")
        module = importlib.import_module(f"lammps_cases.cli.{word}")
        command: click.Command = getattr(module, f"{word}_command")
        command.short_help = COMMANDS[name]
        return command

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        for title, commands in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl(list(commands.items()))

    def shell_complete(self, context: click.Context, incomplete: str) -> list[Any]:
        """Complete a command without importing any."""
        from click.shell_completion import CompletionItem

        if incomplete.startswith("-"):
            return super().shell_complete(context, incomplete)
        return [CompletionItem(name, help=text) for name, text in COMMANDS.items() if name.startswith(incomplete)]

    def resolve_command(self, context: click.Context, args: list[str]) -> Any:
        """Suggest the nearest command for an unknown one."""
        if args and args[0] not in COMMANDS:
            from eos_ref.errors import nearest  # here: importing the reference loads numpy

            raise click.UsageError(f"no such command: {args[0]!r}{nearest(args[0], COMMANDS)}")
        return super().resolve_command(context, args)


@click.group(cls=LazyGroup, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="eos-ref")
@click.pass_context
def group(context: click.Context) -> None:
    """Validate fluids of LAMMPS' RHEO package against an independent reference.

    \b
    Example:  eos-ref run                     all cases against LAMMPS
              eos-ref audit in.deck           your own deck, checked live

    Exit codes: 0 as expected, 1 something differs, 2 wrong usage or bad input, 3 LAMMPS failed or is missing, or a
    part of the report is, 130 interrupted (Ctrl-C, SIGTERM).
    """
    context.obj = time.time_ns()
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


@group.result_callback()
@click.pass_context
def _index(context: click.Context, code: object) -> object:
    """Bring the index of the reports up to date after a command that wrote a report there."""
    if Path("reports").is_dir():
        from lammps_cases.pages import index
        from lammps_cases.records.faults import MissingPart, part
        from lammps_cases.records.wording import lacks

        faults: list[MissingPart] = []
        part("reports/index.html", faults, lambda: index.refresh(Path("reports"), context.obj), None)
        for line in lacks(faults, "not up to date"):
            click.echo(f"eos-ref: {line}", err=True)
        return code or (3 if faults else 0)
    return code


def main() -> None:
    """Entry point: bad input is one line on standard error and exit code 2; a missing engine exit code 3."""
    # A cancelled CI job, or a closed terminal, is like Ctrl-C: workers are stopped, no partial files stay.
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name) and signal.getsignal(getattr(signal, name)) is not signal.SIG_IGN:
            signal.signal(getattr(signal, name), signal.default_int_handler)
    try:
        _check_text(sys.argv[1:])
        code = group.main(prog_name="eos-ref", standalone_mode=False)
    except click.ClickException as error:
        code = _say(2, {"what": "usage", "rule": _one_line(error)}, _one_line(error))
    except (click.Abort, KeyboardInterrupt) as error:
        rule = str(error.__cause__ or error) or "interrupted; files are whole or not written"
        code = _say(130, {"what": "run", "rule": rule}, rule)
    except SystemExit as left:  # by click of completion, with 0; by click or rich where who reads the output has gone
        code = PIPE_CLOSED if left.code else 0
    except Exception as error:
        code = _exit_code(error)
    sys.exit(code if isinstance(code, int) else 0)


def _check_text(words: Sequence[str]) -> None:
    """Refuse words, as names of files, that are not UTF-8: no report could hold them."""
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            raise click.UsageError(f"argument: must be UTF-8 text, found {word!r}") from None


def _one_line(error: click.ClickException) -> str:
    """Describe wrong usage in one line, and say where the right usage is shown."""
    text = " ".join(error.format_message().split()).rstrip(".")
    context = getattr(error, "ctx", None)
    return f"{text} ({context.command_path} --help shows the usage)" if context else text


def _say(code: int, error: dict[str, Any], *lines: str, others: Sequence[dict[str, Any]] = ()) -> int:
    """Report a failure on standard error, with --json as a document on standard output; return its exit code.

    Parameters
    ----------
    error : what, rule, value and where, as far as they are known
    others : further complaints about the same input
    """
    if "--json" in sys.argv[1:]:
        import json

        from lammps_cases.records.wording import plain

        every = [dict.fromkeys(("what", "rule", "value", "where")) | each for each in (error, *others)]
        document = {"error": every[0]} | ({"errors": every} if others else {})
        click.echo(json.dumps(plain(document), indent=1, default=str))
        return code
    for line in lines:
        click.echo(f"eos-ref: {line}", err=True)
    return code


def _exit_code(error: Exception) -> int:
    """Report a foreseen failure in one line; anything else is a fault of this program and keeps its traceback."""
    from eos_ref.errors import InputError  # here, not above: importing the reference loads numpy
    from lammps_cases.engine.session import EngineMissing

    if isinstance(error, InputError):
        first, *others = (
            {"what": each.what, "rule": each.rule, "value": each.found, "where": each.where or None}
            for each in error.errors
        )
        return _say(2, first, *map(str, error.errors), others=others)
    if isinstance(error, EngineMissing):
        text = f"{error} (eos-ref doctor says more)"
        return _say(3, {"what": "LAMMPS", "rule": text}, text)
    if isinstance(error, OSError) and error.strerror and error.filename:
        rule = f"cannot be used: {error.strerror}"
        return _say(2, {"what": "file", "rule": rule, "where": str(error.filename)}, f"{error.filename}: {rule}")
    if isinstance(error, OSError) and error.errno in NO_ROOM:
        rule = f"cannot be written: {error.strerror}"
        with contextlib.suppress(OSError):
            sys.stdout.flush()
            return _say(2, {"what": "output", "rule": rule}, f"output: {rule}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for what Python still holds, and would write at its end
        click.echo(f"eos-ref: output: {rule}", err=True)
        return 2
    import traceback

    traceback.print_exception(error)
    text = "this is a fault of eos-ref itself, not a verdict on LAMMPS"
    return _say(3, {"what": "eos-ref", "rule": text, "value": f"{type(error).__name__}: {error}"}, text)


if __name__ == "__main__":
    main()
