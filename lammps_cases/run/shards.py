"""Division of a run into shards, the same on every machine, and merging of runs: shards, or runs of other cases.

A shard is every n-th case, or a part of equal cost, from the measured cost of each case.
"""

from __future__ import annotations

import hashlib
import heapq
import itertools
import re
import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from eos_ref import InputError
from lammps_cases.records.documents import SCHEMAS, Document
from lammps_cases.records.faults import part
from lammps_cases.records.files import write_atomically
from lammps_cases.records.headline import strictest
from lammps_cases.records.run_record import SHARD, RunRecord, read_run
from lammps_cases.records.wording import counted
from lammps_cases.report.findings import compare_with_ledger
from lammps_cases.run.campaign import cases_of, triaged
from lammps_cases.run.provenance import command_line
from lammps_cases.run.report_files import output_folder, write_kept_run
from lammps_cases.scene.casefile import Case

NAMED = 100  # missing shards named in an error
Seconds = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Costs(BaseModel):
    """The costs of cases, measured once and then the same for all shards."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    schema_: str = Field(SCHEMAS["costs"], alias="schema")
    seconds: dict[str, Seconds] = Field(description="by the name of the case")

    def of(self, names: Iterable[str]) -> dict[str, float]:
        """Return the seconds of some cases; one that was never measured costs the median of the others."""
        usual = statistics.median(self.seconds.values()) if self.seconds else 0.0
        return {name: self.seconds.get(name, usual) for name in names}


DOCUMENT = Document("costs", Costs)


def part_of(cases: Sequence[Case], text: str, costs: Costs | None = None) -> list[Case]:
    """Select the cases of a shard ``i/n``: every n-th from the i-th, or those of the i-th of n equally long parts.

    Raises
    ------
    InputError
    """
    first, _, count = text.partition("/")
    if not (re.fullmatch(SHARD, text, re.ASCII) and int(first) <= int(count)):
        raise InputError("shard", "must be i/n with 1 <= i <= n < 1000000", text)
    if int(first) > len(cases):
        raise InputError("shard", f"is empty: there are {counted(len(cases), 'case')}", text)
    if costs is None:
        return list(cases[int(first) - 1 :: int(count)])
    chosen = balanced(costs.of(case.name for case in cases), int(count))[int(first) - 1]
    return [case for case in cases if case.name in chosen]


def balanced(seconds: Mapping[str, float], count: int) -> list[set[str]]:
    """Deal cases out to shards: the longest first, each to the shard with the least to do so far.

    No shard takes longer than 4/3 of the best division (R. L. Graham, SIAM J. Appl. Math. 17 (1969) 416). Of shards
    equally busy, that with fewer cases comes first, so that cases of no cost are spread as well.
    """
    shards = [set[str]() for _ in range(count)]
    busy = [(0.0, 0, k) for k in range(count)]
    for name in sorted(seconds, key=lambda name: (-seconds[name], name)):
        spent, cases, k = busy[0]
        shards[k].add(name)
        heapq.heapreplace(busy, (spent + seconds[name], cases + 1, k))
    return shards


def divided(names: Iterable[str]) -> str:
    """Return the identity shared by all shards of a run: a hash of the names of its cases."""
    return hashlib.sha256("\n".join(sorted(names)).encode()).hexdigest()[:16]


def check_complete(runs: Sequence[RunRecord]) -> None:
    """Reject shards that are incomplete, or not of one run; runs that are not shards may be joined freely.

    Raises
    ------
    InputError
    """
    shards = {run.shard for run in runs}
    for count in sorted({shard.partition("/")[2] for shard in shards if shard}):
        missing = [shard for k in range(int(count)) if (shard := f"{k + 1}/{count}") not in shards]
        if missing:
            named = ", ".join(missing[:NAMED]) + (", ..." if missing[NAMED:] else "")
            raise InputError("shards", f"must be complete to be merged; missing {named}")
        of_count = [run for run in runs if run.shard.endswith(f"/{count}")]
        wholes = {run.divided for run in of_count}
        if wholes != {""} and wholes != {divided(case.case for run in of_count for case in run.cases)}:
            rule = "must be of one run and share its cases: they were divided otherwise (other cases or --costs)"
            raise InputError("shards", rule, f"{counted(len(of_count), 'shard')} that make up no run")


def merge(directories: Sequence[Path], directory: Path) -> RunRecord:
    """Join runs of different cases on the same engine and write one report.

    Raises
    ------
    InputError
        A folder without a run, different engines, or a case that occurs twice.
    """
    runs = [read_run(folder) for folder in directories]
    for run, folder in zip(runs, directories, strict=True):
        run.check_whole(folder)
    check_complete(runs)
    merged = runs[0]
    for run, folder in zip(runs[1:], directories[1:], strict=True):
        one, other = run.engine, merged.engine
        if (one.distribution, one.library_sha256) != (other.distribution, other.library_sha256):
            rule = f"must be {other.distribution} with the library of the first run"
            raise InputError("engine", rule, one.distribution, str(folder))
        merged.cases += run.cases
        merged.seconds += run.seconds
        merged.older |= run.older
    merged.fail_on = strictest([run.fail_on for run in runs])
    merged.allowed = {name: why for name, why in merged.allowed.items() if all(name in run.allowed for run in runs)}
    merged.shard = merged.divided = ""
    merged.faults = []
    merged.carried = part("carried findings", merged.faults, lambda: compare_with_ledger(merged), None)
    merged.cases.sort(key=lambda record: record.case)
    for case, following in itertools.pairwise(merged.cases):
        if case.case == following.case:
            raise InputError("case", "occurs in two of the runs", case.case)
    merged.command = command_line()
    with output_folder(directory) as folder:
        for source in directories:
            for file in sorted((source / "fields").glob("*.npz")):
                write_atomically(folder / "fields" / file.name, file.read_bytes())
        merged.triage = part("triage", merged.faults, lambda: triaged(merged, cases_of(merged), folder), None)
        write_kept_run(merged.counted(), folder)
    return merged
