"""A user's own decks: audit, with the switches of LAMMPS and the accepted baselines of decks."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import click

from eos_ref.errors import InputError
from lammps_cases.audit.options import AuditOptions, DeckLevelOptions, FinishedOptions
from lammps_cases.cli import shared
from lammps_cases.cli.commands import LAUNCHER, Json, command
from lammps_cases.records.case_parts import CheckRecord
from lammps_cases.records.options import Option, Positional
from lammps_cases.records.progress import Bar
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.records.wording import listed, size

IGNORED = {  # switches without effect on a deck's meaning; with the number of words that follow
    **dict.fromkeys(("log", "l", "screen", "sc", "echo", "e", "cite", "c"), 1),
    **dict.fromkeys(("plog", "pl", "pscreen", "ps"), 1),
    **dict.fromkeys(("nocite", "nc", "nonbuf", "nb"), 0),
}
REFUSED = {
    **dict.fromkeys(("kokkos", "k"), "RHEO has no styles of KOKKOS"),
    **dict.fromkeys(("partition", "p"), "an audit follows one partition"),
    **dict.fromkeys(("reorder", "ro", "r", "mpicolor", "m"), "an audit starts the processes"),
    **dict.fromkeys(("mdi",), "another program would drive LAMMPS"),
    **dict.fromkeys(("plugin",), "no audit loads libraries"),
    **dict.fromkeys(("skiprun", "sr"), "without steps there is nothing to check"),
    **dict.fromkeys(("restart2data", "r2data", "restart2dump", "r2dump", "restart2info", "r2info"),
                    "it converts a file and runs no deck (eos-ref audit --restart FILE --deck DECK checks one)"),
}  # fmt: skip
VARIABLE, PACKAGE = ("-var", "-v"), ("-package", "-pk")


class AsLammps(click.Command):
    """A command that takes the switches of ``lmp`` among its own options: parameters ``var`` and ``package``."""

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        """Take the switches of LAMMPS out, and let click parse the rest."""
        var, package, rest = _taken(args)
        left = super().parse_args(context, rest)
        context.params |= {"var": var, "package": package}
        return left


def _taken(args: Sequence[str]) -> tuple[dict[str, tuple[str, ...]], tuple[str, ...], list[str]]:
    """Return variables, arguments of package commands, and the words that are not switches of LAMMPS."""
    var: dict[str, tuple[str, ...]] = {}
    package: list[str] = []
    rest: list[str] = []
    waiting = list(args)
    while waiting:
        word = waiting.pop(0)
        name = word[1:] if word[:1] == "-" else ""
        if word in VARIABLE:
            variable, first = _next(waiting, word, 2, "-var NAME VALUE...")
            var[variable] = (first, *_values(waiting))
        elif word in PACKAGE:
            package.append(" ".join([*_next(waiting, word, 1, "-pk STYLE ARGUMENT..."), *_values(waiting)]))
        elif name in ("kokkos", "k") and waiting[:1] in (["off"], ["no"], ["false"]):
            waiting.pop(0)
        elif name in REFUSED:
            raise InputError(f"switch {word}", f"cannot be used in an audit: {REFUSED[name]}")
        elif name in IGNORED:
            _next(waiting, word, IGNORED[name], f"{word} WORD")
        else:
            rest.append(word)
    return var, tuple(package), rest


def _next(waiting: list[str], switch: str, count: int, usage: str) -> list[str]:
    if len(waiting) < count or any(word.startswith("--") for word in waiting[:count]):
        raise InputError(f"switch {switch}", f"must be given as {usage}")
    return [waiting.pop(0) for _ in range(count)]


def _values(waiting: list[str]) -> Sequence[str]:
    values = []
    while waiting and waiting[0][:1] != "-":
        values.append(waiting.pop(0))
    return values


BASELINE = "eos-ref-baseline"


@dataclass(frozen=True)
class DeckOptions:
    """The deck, as an argument or, as in LAMMPS, as an option."""

    deck: Annotated[Path | None, Positional()] = None
    of_deck: Annotated[Path | None, Option("The same as DECK.", "--deck", "-in", "-i", metavar="DECK")] = None


@dataclass(frozen=True)
class BaselineOptions:
    """Acceptance of findings, and comparison with accepted ones."""

    accept: Annotated[bool, Option("Keep what the deck did as its baseline, as text for a repository.")] = False
    reason: Annotated[str, Option("Why it is accepted; kept with the baseline.", metavar="TEXT")] = ""
    baseline: Annotated[
        str | None,
        Option(
            f"Compare with the accepted baseline: exit 1 if anything changed.  [default: {BASELINE} with the deck]",
            metavar="[FOLDER]",
            is_flag=False,
            flag_value=BASELINE,
        ),
    ] = None

    def place(self, deck: Path) -> Path:
        """Return the folder of the baseline."""
        named = self.baseline not in (None, BASELINE)
        return Path(self.baseline or "") if named else (deck if deck.is_dir() else deck.parent) / BASELINE


@command(LAUNCHER, cls=AsLammps)
def audit_command(
    given: DeckOptions,
    finished: FinishedOptions,
    options: AuditOptions,
    rescale: Annotated[
        Path | None,
        Option(
            "Write DECK in the unit of length in which m/rho0 is 1.  [default: DECK.rescaled]",
            metavar="[FILE]",
            is_flag=False,
            flag_value="",
        ),
    ] = None,
    *,
    kept: BaselineOptions,
    out: Annotated[Path | None, Option("Report folder.  [default: reports/audit-DECK]")] = None,
    level: DeckLevelOptions,
    as_json: Json = False,
) -> int:
    """Check every atom while LAMMPS runs DECK, unchanged, in a copy of its folder, and say which known bugs affect it.

    It takes the switches of lmp, and runs in a copy of the current folder if the files that DECK reads lie there.

    DECK may be a folder: all decks below it (in.*, *.in, *.lmp) are audited. Findings that are accepted, with reason
    and date, and limits stand in eos-ref.toml in their folder.

    It checks whatever a force evaluation computes from positions, velocities, densities, energies and phases, as used
    by the forces: the pressure by the laws that the deck defines at that moment, gradients, surfaces, forces. Loops,
    includes, several runs and redefined fixes are followed. If LAMMPS stops with an error, the reference continues
    from the last good sample to find out why.

    With --dump or --restart only the set-up is run: the columns of a dump are checked against each other, to the
    digits that it holds; LAMMPS reads a restart file and evaluates its forces once.

    \b
    Examples: eos-ref audit in.deck --every 10 --steps 1000
              eos-ref audit in.deck --fields pressure,surface,grad/v
              eos-ref audit --dump out.dump --deck in.deck
              eos-ref audit in.deck --rescale in.rescaled
              eos-ref audit decks --accept --reason "first baseline"
              eos-ref audit decks --baseline
    """
    from lammps_cases.audit.command import audit_into
    from lammps_cases.audit.rescale import rescale as rescale_deck
    from lammps_cases.engine import installations
    from lammps_cases.run import provenance

    reason, accept = kept.reason, kept.accept
    if (reason and not accept) or ((accept or kept.baseline) and (finished.dump or finished.restart)):
        rule = "needs --accept" if reason and not accept else "is of a deck that runs, not of --dump or --restart"
        raise InputError("--reason" if reason and not accept else "--accept or --baseline", rule)
    if (given.deck is None) == (given.of_deck is None):
        before = " before -var" if options.var else ""
        raise InputError("deck", f"must be given once{before}: eos-ref audit DECK, or --deck DECK")
    deck = given.deck or given.of_deck
    assert deck is not None
    chosen = installations.resolve(level.engine)
    directory = out or Path("reports") / f"audit-{(finished.dump or finished.restart or deck).resolve().name}"
    place = kept.place(deck)
    if kept.baseline and not accept:
        readable(place)
    with Bar(quiet=as_json) as bar:
        how = replace(options, engine=chosen.site, progress=bar)
        target = rescale if rescale and rescale.name else Path(f"{deck.name}.rescaled")
        written = [] if rescale is None else rescale_deck(deck, how, target)
        run = audit_into(directory, deck, how, chosen, provenance.command_line(), level.level, finished)
    changes: Iterable[str] = ()
    if accept:
        changes = accepted(directory, reason, place, prune=deck.is_dir())
    elif kept.baseline:
        from lammps_cases.versions.baseline import check_decks

        found = check_decks(run, directory, place, whole=deck.is_dir())
        again = shlex.join(["eos-ref", "audit", str(deck), "--accept"])
        changes = shared.compared(run, directory, found, as_json, again)
    if not as_json:
        for case in run.cases:
            for line in () if deck.is_dir() else field_table(case):
                click.echo(line)
            for line in report_lines(case)[-1 if deck.is_dir() else 0 :]:
                shared.show(line, "  ")
        for line in written:
            shared.show(f"rescaled: {line}", "  ")
    return shared.finish(run, directory, as_json, changes)


def field_table(case: CaseRecord) -> list[str]:
    """Return the lines of a table of the fields; empty if none was checked."""
    from lammps_cases.records import deck_wording

    looks: dict[tuple[str, int], list[CheckRecord]] = {}
    for check in case.checks:
        looks.setdefault((check.field, check.type), []).append(check)
    lines = ["field        type samples  atoms   |LAMMPS-ref|     /bound worst step worst atom  verdict"]
    for record in case.fields:
        of_field = looks.get((record.field, record.atom_type or 0), [])
        worst = max(of_field, key=lambda check: size(check.max_over_bound), default=None)
        lines.append(
            f"{record.field:12s} {record.atom_type or 'all':>4} {len(of_field):6d} {worst.natoms if worst else 0:7d} "
            f"{record.max_abs:14.3g} {record.max_over_bound:10.3g} {record.worst_step:9d} {record.worst_id:10d}  "
            f"{deck_wording.verdict(record)}" + (f" by {listed(record.explained_by)}" if record.explained_by else "")
        )
    return lines if case.fields else []


def report_lines(case: CaseRecord, most: int = 20) -> list[str]:
    """Return the checks outside the bound, the report's statements about the deck, and how the run ended."""
    from lammps_cases.audit import budgets
    from lammps_cases.report.statements import NEVER, SUBJECTS, statements

    bad = [check for check in case.checks if check.verdict == "differs"]
    outside = [
        f"outside: {check.field} of type {check.type or 'all'}, run {check.run}, step {check.step}: "
        f"{check.max_abs:.3g} = {check.max_over_bound:.3g} x bound at atom {check.worst_id}"
        for check in bad[:most]
    ]
    if len(bad) > most:
        outside.append(f"... {len(bad) - most} more samples outside, all in run.json ...")
    budget = [f"budget: {line}" for line in budgets.lines(case)] if case.budgets else []
    end = f"{case.case}: {case.verdict}, {case.steps} steps, {case.natoms} atoms"
    if case.message and case.as_expected:  # else it follows, with the reason why the run stopped
        end += f": {case.message}"
    # The most important comes last, where it is read first.
    said = sorted(statements(case, NEVER), key=lambda line: -SUBJECTS.index(line.subject))
    return [*outside, *(str(line) for line in said if line.subject != "stopped"), *budget, end]


def readable(place: Path) -> None:
    """Raise if there is no baseline, before anything runs.

    Raises
    ------
    InputError
    """
    from eos_ref import InputError
    from lammps_cases.records import folders
    from lammps_cases.versions.baseline import IDENTITY

    if not (folders.present(place) / IDENTITY).exists():
        raise InputError("baseline", "none is accepted here (eos-ref audit DECK --accept)", where=str(place))


def accepted(directory: Path, reason: str, place: Path, prune: bool) -> list[str]:
    """Accept the report of an audit as the baseline of its decks; return lines about the changes."""
    from lammps_cases.records.wording import counted
    from lammps_cases.run.provenance import command_line
    from lammps_cases.versions import pairs
    from lammps_cases.versions.acceptance import accept_decks

    of = accept_decks(directory, reason, place, command_line(), prune)
    changes = [f"first baseline: {counted(of.cases, 'deck')}"]
    if of.changes is not None:
        changes = [*pairs.lines(of.changes, "the old", "the new"), *pairs.faults(of.changes)]
    dropped = [f"dropped: {', '.join(of.dropped)}"] if of.dropped else []
    return [*changes, *dropped, f"baseline: {of.folder}{'' if of.written else ' (unchanged)'}"]
