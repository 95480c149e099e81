"""Every use of a case, run for the one that `test_new_case` adds to a copy of the packages."""

from __future__ import annotations

from contextlib import closing
from importlib.metadata import version

from lammps_cases.claims.model import claims
from lammps_cases.claims.verdicts import trace
from lammps_cases.engine.session import Session
from lammps_cases.records.run_record import EngineRecord
from lammps_cases.run import flow, prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.changes import catalogue
from tests.support.claim_records import KNOWN

NEW = "walked"
(case,) = casefile.select(casefile.load(tag="eos"), (NEW,))
assert case.shipped and set(case.exercises) <= catalogue().keys()
leads = trace(claims(), KNOWN)
assert NEW in leads.unclaimed and leads.complete, leads

# judged: LAMMPS within the bound, every change seen that it is for
ready = prepared_case.prepare(case)
with closing(Session()) as session:
    answer = session.run(ready.jobs[0])
record = flow.judge(None, ready, [answer], EngineRecord(name="env", distribution=version("lammps")))[0]
assert record.verdict in ("exact", "pass") and not record.unexercised, record
assert all(record.exercises[change] for change in case.exercises)

print(NEW)
