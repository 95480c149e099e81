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

# command: its module, which holds NAME_command with _ for -, and one line of help
FIRST = {
    "Commands": {
        "run": ("run", "Run cases against LAMMPS and write a report: the main job."),
        "audit": ("audit", "Check your input deck, run unmodified, while LAMMPS runs it."),
        "explain": ("explain", "Show the purpose of a case, its laws and bounds, and what it models."),
        "findings": ("findings", "List the findings: where LAMMPS differs from its manual."),
        "report-bug": (
            "findings",
            "Write a bug report for LAMMPS: a self-contained deck that prints PASS or FAIL, and the text.",
        ),
        "report": ("run", "Render the report of a finished run again."),
        "compare": ("versions", "Compare two engines, two runs, or a run and a baseline, field by field."),
        "accept": ("versions", "Accept a run as the baseline of its engine, with a reason."),
        "chart": ("studies", "Chart speed against accuracy: LAMMPS, the reference, other methods."),
        "doctor": ("tools", "Say what is installed, what works, and how to fix what does not."),
    }
}
DEV = {
    "Cases and runs": {
        "list": ("run", "List the cases."),
        "diagnose": ("run", "Group the red cases of a finished run, and say what could cause them."),
        "shrink": ("findings", "Make the smallest scene that still fails the same way."),
        "merge": ("run", "Join the shards of a run."),
    },
    "Versions": {
        "bisect": ("versions", "Name the first of several engines that changed."),
        "adopt": ("versions", "Register a new LAMMPS version: which findings persist, disappear or appear."),
        "history": ("history", "Show how errors, times and verdicts changed from version to version."),
        "claims": ("claims", "Check the manual's claims: which hold, on which engine, according to which cases."),
    },
    "Research": {
        "validate": ("studies", "Run flows with experimental, numerical or analytic reference data."),
        "advise": ("advise", "Choose time step, speed of sound and kernel of your deck, with reasons."),
        "stability": ("studies", "Map where methods fail, in LAMMPS and in the reference."),
        "examples": ("studies", "Judge LAMMPS' own RHEO examples, and break down their errors."),
        "logs": ("studies", "Compare runs of LAMMPS' own RHEO examples with the logs shipped with them."),
    },
    "Maintenance": {
        "inputs": ("studies", "Give bad input to LAMMPS and the reference: which refuses it, and how clearly."),
        "bench": ("tools", "Measure speed relative to peers, as ratios."),
        "kit": ("tools", "Write the files that run this in a CI service, or in shards on a cluster."),
        "completion": (
            "commands",
            "Print the script that lets the shell complete cases, tags, findings and engines.",
        ),
    },
}
COMMANDS = {name: at for page in (FIRST, DEV) for commands in page.values() for name, at in commands.items()}
EARLIER = {"ledger": "findings"}  # earlier names, which still work
PIPE_CLOSED = 141  # exit code, as in shells after SIGPIPE
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # of a file, or of the target of the output


class LazyGroup(click.Group):
    """A group that shows one page of commands but accepts all; they are imported on use."""

    def __init__(self, *args: Any, page: dict[str, dict[str, tuple[str, str]]], **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.page = page

    def list_commands(self, context: click.Context) -> list[str]:
        """List the names in the order in which a user meets them."""
        return [name for commands in self.page.values() for name in commands]

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Import the module of a command."""
        if name == "dev":
            return dev
        name = EARLIER.get(name, name)
        if name not in COMMANDS:
            return None
        module, text = COMMANDS[name]
        word = name.replace("-", "_")
        command: click.Command = getattr(importlib.import_module(f"lammps_cases.cli.{module}"), f"{word}_command")
        command.short_help = text
        return command

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands of the page without importing them."""
        for title, commands in self.page.items():
            with formatter.section(title):
                formatter.write_dl([(name, text) for name, (_, text) in commands.items()])

    def shell_complete(self, context: click.Context, incomplete: str) -> list[Any]:
        """Complete a command without importing any; on the first page also those of the second."""
        from click.shell_completion import CompletionItem

        if incomplete.startswith("-"):
            return super().shell_complete(context, incomplete)
        names = list(COMMANDS) if self.page is FIRST else self.list_commands(context)
        return [CompletionItem(name, help=COMMANDS[name][1]) for name in names if name.startswith(incomplete)]

    def resolve_command(self, context: click.Context, args: list[str]) -> Any:
        """Suggest the nearest command for an unknown one."""
        if args and args[0] not in (*COMMANDS, *EARLIER, "dev"):
            from eos_ref.errors import nearest  # here: importing the reference loads numpy

            raise click.UsageError(f"no such command: {args[0]!r}{nearest(args[0], COMMANDS)}")
        return super().resolve_command(context, args)


@click.command(
    cls=LazyGroup, page=FIRST, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]}
)
@click.version_option(package_name="eos-ref")
@click.pass_context
def group(context: click.Context) -> None:
    """Validate fluids of LAMMPS' RHEO package against an independent reference.

    \b
    Example:  eos-ref run                     all cases against LAMMPS
              eos-ref audit in.deck           your own deck, checked live
              eos-ref dev                     the other commands

    Exit codes: 0 as expected, 1 something differs, 2 wrong usage or bad input, 3 LAMMPS failed or is missing, or a
    part of the report is, 130 interrupted (Ctrl-C, SIGTERM).
    """
    context.obj = time.time_ns()
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


@click.command(cls=LazyGroup, page=DEV, invoke_without_command=True)
@click.pass_context
def dev(context: click.Context) -> None:
    """List the commands for cases, versions, research and maintenance; each works without dev, too.

    \b
    Example:  eos-ref dev history --last 5
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


@group.result_callback()
@click.pass_context
def _index(context: click.Context, code: object) -> object:
    """Update the index of the reports after a command that wrote a report there."""
    if Path("reports").is_dir():
        from lammps_cases.records.faults import MissingPart, part
        from lammps_cases.records.wording import lacks
        from lammps_cases.report.pages import index

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
    except SystemExit as left:  # of click after a completion, with 0; of click or rich without a reader
        code = PIPE_CLOSED if left.code else 0
    except Exception as error:
        code = _exit_code(error)
    sys.exit(code if isinstance(code, int) else 0)


def _check_text(words: Sequence[str]) -> None:
    """Reject words, as names of files, that are not UTF-8: no report could hold them."""
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            raise click.UsageError(f"argument: must be UTF-8 text, found {word!r}") from None


def _one_line(error: click.ClickException) -> str:
    """Describe wrong usage in one line, with the command that shows the right usage."""
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
    """Report a foreseen failure in one line; any other is a fault of this program and keeps its traceback."""
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
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for what Python still buffers, and would write at its end
        click.echo(f"eos-ref: output: {rule}", err=True)
        return 2
    import traceback

    traceback.print_exception(error)
    text = "this is a fault of eos-ref itself, not a verdict on LAMMPS"
    return _say(3, {"what": "eos-ref", "rule": text, "value": f"{type(error).__name__}: {error}"}, text)


if __name__ == "__main__":
    main()
