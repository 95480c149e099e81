"""The table: classes of LAMMPS' reactions, its reading of an input, and findings that name existing inputs."""

from __future__ import annotations

import fnmatch
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.claims.probes.run import Reply
from lammps_cases.engine.workers import Workers
from lammps_cases.findings import LEDGER
from lammps_cases.findings.entry import OutcomeFinding
from lammps_cases.versions.inputs.table import counts, digest, every, row, select, table

OF_INPUTS = [entry for entry in LEDGER if isinstance(entry, OutcomeFinding)]
SAMPLE = {
    "fix-rheo.kernel.kstyle.lower-case": ("clear error", ""),
    "fix-rheo.kernel.zmin.fraction": ("clear error", ""),
    "fix-rheo.kernel.zmin.minus-one": ("no effect", ""),
    "fix-rheo.kernel.rho0-2.zero": ("silent NaN", ""),
    "fix-rheo.kernel.rho0-1.quoted-minus": ("warning", ""),
    "fix-rheo.kernel.zmin.left-out": ("misleading error", ""),
    "fix-rheo-pressure.linear.types.hyphen": ("silent acceptance", "fix 3 all rheo/pressure * linear 1 tait/water"),
    "fix-rheo-pressure.linear.types.one": ("silent acceptance", ""),
    "fix-rheo-pressure.linear.types.two-stars": ("crash", ""),
    "fix-rheo-pressure.linear.types.full-width": ("clear error", ""),
    "fix-rheo-pressure.linear.command.legal": ("no effect", ""),
}


def test_inputs_of_both_kinds_have_unique_names() -> None:
    ids = [one.id for one in every()]
    assert len(set(ids)) == len(ids) >= 600
    assert {"overflow", "fix-rheo.kernel.cut.nan"} <= set(ids)
    assert [one.id for one in select(["mass.plain.mass.nan", "overf*"])] == ["mass.plain.mass.nan", "overflow"]
    with pytest.raises(InputError, match="no such input"):
        select(["nothing-like-it"])


def test_findings_name_existing_inputs_each_once() -> None:
    named = [pattern for entry in OF_INPUTS for pattern in entry.expected_inputs]
    assert named
    assert len(named) == len(set(named))
    ids = [one.id for one in every()]
    for pattern in named:
        assert fnmatch.filter(ids, pattern), pattern
    for id in ids:
        own = {e.id for e in OF_INPUTS if any(fnmatch.fnmatchcase(id, pattern) for pattern in e.expected_inputs)}
        assert len(own) <= 1, (id, own)


def answered(**arrays: Any) -> Reply:
    return Reply("answered", arrays={"id": np.arange(2), "pressure": np.array([1.0, 2.0])} | arrays)


def test_row_classifies_the_reaction_of_lammps() -> None:
    (bad,) = select(["fix-rheo-pressure.linear.types.hyphen"])
    one = row(bad, answered(), answered())
    assert (one.reaction, one.candidate, one.ledger) == ("no effect", True, "hyphen-range-accepted")
    assert (one.area, one.about, one.kind, one.mutation) == ("fix rheo/pressure", "types", "types", "hyphen")
    assert one.agreement == "the reference alone refuses it"
    one = row(bad, answered(pressure=np.array([1.0, 3.0])), answered())
    assert one.reaction == "silent acceptance"
    one = row(bad, answered(pressure=np.array([1.0, np.inf])), answered())
    assert one.reaction == "silent NaN"
    one = row(bad, Reply("refused", "ERROR: Invalid range string: 1-2"), answered())
    assert (one.reaction, one.candidate, one.ledger, one.agreement) == ("clear error", False, "", "both refuse")
    one = row(bad, Reply("refused", "ERROR: Illegal tait/water"), answered())
    assert one.reaction == "misleading error"
    one = row(bad, Reply("refused", "ERROR: Illegal fix command"), answered())
    assert one.reaction == "vague error"
    warned = Reply("answered", arrays=answered().arrays, log="WARNING: something (src/x.cpp:1)")
    assert row(bad, warned, answered()).reaction == "warning"
    assert row(bad, warned, warned).reaction == "no effect", "the control has the same warning"


def test_digest_depends_on_the_answer() -> None:
    assert digest(answered()) == digest(answered()) != digest(answered(x=np.zeros(2)))
    assert digest(Reply("refused", "no")) == ""


@pytest.mark.lammps
def test_sample_on_lammps() -> None:
    with Workers(None, 2) as workers:
        rows = table(workers, inputs=select(list(SAMPLE)))
    found = {one.id: (one.reaction, one.taken_for) for one in rows}
    assert found == SAMPLE
    assert all(one.text for one in rows)
    by_argument = counts(rows)
    assert by_argument["fix rheo", "zmin"] == {"clear error": 1, "no effect": 1, "misleading error": 1}
    assert by_argument["fix rheo/pressure", "types"]["both take it"] == 1
