"""A cell is run to its first failure: step, atom, value and the particles before, however its engine ends."""

from __future__ import annotations

import contextlib
import pickle
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from eos_ref.evaluation.time_step import Simulation
from lammps_cases.engine.session import Session
from lammps_cases.engine.workers import Workers
from lammps_cases.setup import reference_side
from lammps_cases.studies.flows.flow import Snapshot, Start
from lammps_cases.studies.stability import kinds, runs
from lammps_cases.studies.stability.maps import timestep
from lammps_cases.studies.stability.model import ENGINES, Axis, Engine, FailureCriteria, MapCell, StabilityMap
from lammps_cases.studies.stability.probe import Examined, examine, follow
from lammps_cases.studies.stability.runs import ReferenceRun, Stopped, open_run, saying
from tests.support.faulty_lammps import faulty_lammps
from tests.support.stability_scenes import channel, resting, unstable

pytestmark = pytest.mark.lammps

WATCH = timestep.watch(1e-3)


@pytest.fixture(scope="module")
def living() -> Session:
    return Session()


def followed(start: Start, watch: FailureCriteria, side: Engine, living: Session) -> Examined:
    return follow(partial(open_run, start, watch, side, living), kinds.subject(start), watch, start.steps[-1])


sides = pytest.mark.parametrize("side", ENGINES)


# --- the first step


def by_hand(start: Start, watch: FailureCriteria) -> tuple[int, kinds.ParticleFailure, Simulation]:
    """Return step, failure, and simulation one step before, by single steps."""
    scene, atoms = start.case.scene, start.atoms
    made = [reference_side.simulation(scene, atoms) for _ in range(2)]
    for step in range(1, 1000):
        made[0].run(1, start.timestep)
        s = made[0].state
        look = Snapshot(step, s.x_nc, s.v_nc, s.rho_n, made[0].output("pressure"))
        found = kinds.first(kinds.subject(start), watch, look, watch.energy)
        if found is not None:
            return step, found, made[1]
        made[1].run(1, start.timestep)
    raise AssertionError("nothing failed")


def test_step_atom_and_value_are_those_of_the_first_failure(living: Session) -> None:
    start = unstable()
    step, found, before = by_hand(start, WATCH)
    assert step > 2 and step % WATCH.every  # between two looks
    ours, theirs = (followed(start, WATCH, side, living) for side in ENGINES)
    outcome = ours.outcome
    assert (outcome.kind, outcome.step, outcome.atom, outcome.value) == (found.kind, step, found.atom, found.value)
    assert ours.before is not None
    assert ours.before["step"] == step - 1
    assert ours.before["failing"].tolist() == [found.atom]
    assert np.array_equal(ours.before["v"], before.state.v_nc)
    assert np.array_equal(ours.before["rho"], before.state.rho_n)
    assert (outcome.kind, outcome.step, outcome.atom) == tuple(
        getattr(theirs.outcome, name) for name in ("kind", "step", "atom")
    )
    # LAMMPS' forces lack the volumes, which differ from 1 by the Mach number; the energy has grown by its square.
    assert outcome.value is not None
    assert outcome.value == pytest.approx(theirs.outcome.value, rel=2 * 1e-3 * np.sqrt(outcome.value))


@sides
@pytest.mark.parametrize("every", [1, 3, 1000])
def test_result_does_not_depend_on_the_interval_of_looks(side: Engine, every: int, living: Session) -> None:
    found, again = (followed(unstable(), replace(WATCH, every=n), side, living) for n in (WATCH.every, every))
    assert again.outcome == found.outcome
    assert again.before is not None and found.before is not None
    assert np.array_equal(again.before["v"], found.before["v"])


@sides
def test_default_energy_scale_is_that_of_the_first_look(side: Engine, living: Session) -> None:
    start = unstable(1e-6)
    watch = FailureCriteria(every=20, growth=10.0)
    run = open_run(start, watch, side, living)
    of = kinds.subject(start)
    energies = [kinds.kinetic_energy(of.mass_n, run.snapshot().v_nc)]
    for _ in range(40):
        run.advance(1)
        energies.append(kinds.kinetic_energy(of.mass_n, run.snapshot().v_nc))
    scale = energies[20]
    assert scale > energies[0]
    step = next(k for k in range(21, 41) if energies[k] > 10 * scale)
    outcome = followed(start, watch, side, living).outcome
    assert (outcome.kind, outcome.step) == ("energy growth", step)
    assert outcome.value == energies[step] / scale


@sides
def test_sound_runs_are_stable_and_surfaces_are_read_from_the_engine(side: Engine, living: Session) -> None:
    examined = followed(resting(25), replace(WATCH, closest=0.9), side, living)
    assert (examined.outcome.kind, examined.before) == ("stable", None)
    for surface, wanted in ({60: 0, 66: 1}, ("stable",)), ({60: 0, 66: 0}, ("misclassified surface", 0, 66, 1.0)):
        found = followed(channel(), FailureCriteria(surface=surface), side, living).outcome
        assert (found.kind, found.step, found.atom, found.value)[: len(wanted)] == wanted


@sides
def test_particles_that_leave_an_open_box_are_lost(side: Engine, living: Session) -> None:
    start = channel(60)
    v_nc = np.zeros(start.atoms.x_nc.shape)
    v_nc[-1, 1] = 10.0
    start = replace(start, atoms=replace(start.atoms, v_nc=v_nc))
    outcome = followed(start, FailureCriteria(every=7), side, living).outcome
    assert (outcome.kind, outcome.atom) == ("lost particles", len(start.atoms))
    run = open_run(start, FailureCriteria(), side, living)
    assert outcome.step is not None
    run.advance(outcome.step - 1)
    assert run.snapshot().x_nc[-1, 1] < 13.0
    with contextlib.suppress(Stopped):  # LAMMPS stops at once if it happens to list neighbours
        run.advance(1)
        assert run.snapshot().x_nc[-1, 1] > 13.0


def test_nan_positions_are_detected_in_their_step(living: Session) -> None:
    """The reference stops in the middle of a step; its state at that point is examined."""
    start = unstable(0.3)
    huge = replace(start, atoms=replace(start.atoms, v_nc=start.atoms.v_nc * 1e200))
    outcome = followed(huge, FailureCriteria(), "reference", living).outcome
    assert outcome.kind in ("non-finite", "lost particles", "negative density")
    assert outcome.step == 1


# --- ends that particles do not cause


def changed(start: Start, **keys: Any) -> Start:
    return replace(start, case=replace(start.case, scene=start.case.scene.model_copy(update=keys)))


def test_refusals_are_errors_with_their_message(living: Session) -> None:
    """A law that the reference refuses and LAMMPS accepts; a style unknown to LAMMPS, which stays usable."""
    start = channel(3)
    law = start.case.scene.pressure[0].model_copy(update={"style": "tait/general", "A3": None, "gamma": 0.0})
    refused, unknown = changed(start, pressure=(law,)), changed(start, violate="unknown-pressure-style")
    ours, theirs = (followed(s, FailureCriteria(), e, living) for s, e in ((refused, "reference"), (unknown, "lammps")))
    assert [(end.outcome.kind, end.outcome.step) for end in (ours, theirs)] == [("error", 0)] * 2
    assert "gamma of tait/general" in ours.outcome.message
    assert "Illegal fix command" in theirs.outcome.message or "ubic" in theirs.outcome.message
    assert followed(refused, FailureCriteria(), "lammps", living).outcome.kind != "error"
    assert followed(channel(), FailureCriteria(), "lammps", living).outcome.kind == "stable"


@pytest.mark.parametrize(
    ("of", "method", "side"), [(Session, "read", "lammps"), (ReferenceRun, "snapshot", "reference")]
)
def test_bugs_of_this_project_are_not_blamed_on_an_engine(
    of: type, method: str, side: Engine, monkeypatch: pytest.MonkeyPatch, living: Session
) -> None:
    def mistaken(*arguments: object) -> None:
        raise TypeError("a mistake")

    monkeypatch.setattr(of, method, mistaken)
    with pytest.raises(TypeError, match="a mistake"):
        followed(resting(5), FailureCriteria(), side, living)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("ERROR: Lost atoms: original 100 current 99 (src/thermo.cpp:1)", "lost particles"),
        ("ERROR on proc 0: Non-numeric atom coords - simulation unstable", "non-finite"),
        ("ERROR: Unknown fix style", "error"),
    ],
)
def test_kinds_of_lammps_errors(text: str, kind: str) -> None:
    assert saying(text) == kind


# A package named lammps: the real one, except that certain masses cause a fault in the 38th step.
FAULTY = """
import os, signal, time
class lammps(_lammps):
    steps, fault = 0, None

    def commands_string(self, text):
        self.fault = next((f for m, f in FAULTS.items() if f"mass 1 {m}.0" in text), None)
        self.steps = 0
        return super().commands_string(text)

    def command(self, text):
        if text.startswith("run "):
            self.steps += int(text.split()[1])
            if self.steps >= 38 and self.fault:
                self.fault()
        return super().command(text)

def _once():
    if not os.path.exists(__file__ + ".once"):
        open(__file__ + ".once", "w").close()
        os.kill(os.getpid(), signal.SIGSEGV)

def _error():
    raise Exception("ERROR: made up by the test")

FAULTS = {101: lambda: os.kill(os.getpid(), signal.SIGSEGV), 102: lambda: time.sleep(600), 103: _error,
    104: _once}
"""


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workers]:
    """Workers whose LAMMPS has faults in the 38th step."""
    site = faulty_lammps(tmp_path_factory.mktemp("site"), FAULTY)
    with Workers(str(site), 1) as workers:
        yield workers


@pytest.mark.parametrize(
    ("mass", "side", "end", "words", "before"),
    [
        (101.0, "lammps", ("crash", 38), "SIGSEGV", 37),
        (104.0, "lammps", ("crash", 38), "(once in two runs)", None),
        (102.0, "lammps", ("hang", 31), "", 30),
        (103.0, "lammps", ("error", 38), "ERROR: made up by the test", 37),
        (100.0, "lammps", ("stable", None), "", None),
        (101.0, "reference", ("stable", None), "", None),
    ],
    ids=["death", "death-that-does-not-recur", "hang", "error", "sound", "not-the-reference"],
)
def test_end_of_a_worker_is_reported_at_its_step(
    mass: float, side: Engine, end: tuple[str, int | None], words: str, before: int | None, faulty: Workers
) -> None:
    """A hang after its last look, with the time limit as its seconds."""
    start: Callable[[MapCell], Start] = lambda cell: resting(60, mass)  # noqa: E731
    axis, hangs = Axis("x", 0, 1, 1), end[0] == "hang"
    of = StabilityMap("rest", "", "", axis, axis, (0.0,), start, lambda cell: FailureCriteria())
    found = examine(of, MapCell("rest", 0.0, 0.0), side, faulty, 4.0 if hangs else 20.0)
    outcome = found.outcome
    assert outcome.kind == end[0] and words in outcome.message and outcome.steps == 60
    if "once" not in words:
        assert outcome.step == end[1]
    if before is not None:
        assert found.before is not None and found.before["step"] == before
        assert np.array_equal(found.before["x"], resting(60).atoms.x_nc[:, :2])
    assert not hangs or outcome.seconds == 4.0


def test_shorter_second_run_keeps_the_first_failure(monkeypatch: pytest.MonkeyPatch, living: Session) -> None:
    """LAMMPS may read uninitialised memory, so that the second run fails on its own."""
    start = unstable()
    seen = followed(start, WATCH, "reference", living)
    stop, made = Stopped("lost particles", "Lost atoms:  2", 7), list[Start]()
    again = pickle.loads(pickle.dumps(stop))  # as from a worker
    assert (again.kind, again.message, again.atom) == ("lost particles", "Lost atoms: 2", 7)

    class Once(ReferenceRun):
        def __init__(self, of: Start, *given: Any) -> None:
            if made:
                raise stop
            made.append(of)
            super().__init__(of, *given)

    monkeypatch.setattr(runs, "ReferenceRun", Once)
    examined = followed(start, WATCH, "reference", living)
    assert examined.outcome.kind == seen.outcome.kind
    assert examined.outcome.message == "(run again, it ended earlier: Lost atoms: 2)"
    assert examined.outcome.step is not None and examined.outcome.step % WATCH.every == 0  # the look after the failure
    assert examined.before is not None and examined.before["step"] == examined.outcome.step - WATCH.every
