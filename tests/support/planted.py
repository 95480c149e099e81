"""A judged run in which the reference with a fault stands in for LAMMPS, and its triage."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.trajectory import visit
from lammps_cases.records.case_parts import worst
from lammps_cases.records.files import arrays_files, write_arrays
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.verdict import particle_model
from lammps_cases.verdict.diagnosis.triage import triage
from lammps_cases.verdict.problems import problem_of

ENGINE = "2099.1.1"


def red_run(
    folder: Path,
    names: Sequence[str],
    stages: type[ArrayEvaluator] = ArrayEvaluator,
    stepping: type[Simulation] = Simulation,
    seconds: float = 30.0,
) -> RunRecord:
    """Return a run of cases with its triage; the changed reference supplies LAMMPS' numbers."""
    cases, predictor = casefile.select(casefile.load(), names), Predictor()
    records = []
    for case in cases:
        ready, steps = prepared_case.prepare(case), case.scene.snapshots
        problem = problem_of(case.scene, ready.atoms, case.where, steps)
        sim = problem.simulation(stages, stepping)
        visited = visit(sim, steps, problem.timestep, problem.stops)
        snapshots = [{name: np.array(sim.output(name), float) for name in problem.fields} for _ in visited]
        judged = particle_model.compare_and_explain(problem, case.name, ready.atoms.id_n, snapshots, ENGINE, predictor)
        fields = [comparison.record for comparison in judged.comparisons]
        verdict = worst([field.verdict for field in fields])
        record = CaseRecord(case=case.name, verdict=verdict, fields=fields, blame=judged.first, beyond=judged.beyond)
        records.append(record)
        if not record.as_expected:
            arrays = {
                f"{step} {name}": values
                for step, snapshot in zip(steps, snapshots, strict=True)
                for name, values in snapshot.items()
            }
            write_arrays(arrays_files(folder, case.name)[2], arrays)
    run = RunRecord(engine=EngineRecord(distribution=ENGINE), reference={}, cases=records).counted()
    run.triage = triage(run, cases, folder, predictor, seconds)
    return run
