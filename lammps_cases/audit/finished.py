"""`audit_dump`: the columns of a dump that a deck has written, checked against each other without running the deck."""

from __future__ import annotations

import contextlib
import shlex
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from eos_ref.eos.bounds import EPS
from eos_ref.errors import InputError
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model
from eos_ref.numbers.rounded import Rounded, error, value
from lammps_cases.audit import dumps, fields
from lammps_cases.audit.dumps import FrameEvaluation, FrameSample
from lammps_cases.audit.effects import Explained, effects
from lammps_cases.audit.messages import DeckDump, DeckEnd, RunFacts, RunSetup, SampleRow, SampleRows
from lammps_cases.audit.options import AuditOptions, AuditResult
from lammps_cases.audit.sample import Printed, judged, known
from lammps_cases.audit.supervise import case_name, described
from lammps_cases.audit.verdict import Findings, by_field
from lammps_cases.comparison.compare import Comparison
from lammps_cases.records import wording
from lammps_cases.records.case_parts import BreakRecord, LawRecord, Seconds
from lammps_cases.records.run_record import EngineRecord, RunRecord
from lammps_cases.scene.fields import FIELDS
from lammps_cases.scene.lammps_files import SOLID, CutOff, FileSnapshot, snapshots
from lammps_cases.verdict.model_fields import derived
from lammps_cases.verdict.outcome import leave_unchecked

NO_COLUMN = "no column of it in the dump (compute rheo/property/atom NAME, of vectors and tensors NAME/*)"
NO_PARTICLE = "no particle can be compared"
OPEN = "cannot be compared, by the digits, at the cutoff or a surface that rounding decides, or for want of a number"
NO_FORCES = "no columns fx fy fz in the dump"
NO_RATE = "no column of it in the dump (compute property/atom drho)"


class Run(NamedTuple):
    """A run of the deck, by its number, with its model, or an error where it has no model that can be followed."""

    number: int
    setup: RunSetup
    model: Model | InputError


class Frame(NamedTuple):
    """A snapshot in its run; ``set_up``: whether it is the snapshot of the run's set-up."""

    snapshot: FileSnapshot
    run: Run
    set_up: bool


def audit_dump(dump: Path, deck: Path, options: AuditOptions) -> AuditResult:
    """Check the columns of a dump against each other; the deck's runs are set up, but not carried out.

    Parameters
    ----------
    dump : Path
        A dump custom, text or binary, with one or more snapshots; of a truncated file, the complete ones count.
    deck : Path
        The deck that has written it.
    options : AuditOptions

    Returns
    -------
    AuditResult
        One case, as of `lammps_cases.audit.supervise.audit_deck`.

    Raises
    ------
    InputError
        No such dump; one that the deck does not write, or of steps that it does not reach.
    EngineMissing
    """
    begin = time.perf_counter()
    shots, rest = _read(dump)
    findings, setups = described(deck, options)
    runs = [_run(k, setup) for k, setup in enumerate(setups.runs, 1)]
    columns = dumps.columns_of(dump, list(shots[0].columns), setups.dumps, runs[0].setup)
    writing = _writing(columns.dump, runs)
    audit = _Audit(columns, options, findings)
    for snapshot in shots:
        if list(snapshot.columns) != list(columns.names):
            raise InputError("columns", "must be the same in every snapshot", snapshot.step, dump.name)
        frame = _frame(snapshot, writing, dump.name)
        writing = writing[writing.index(frame.run) :]  # steps may be counted from 0 again
        _check(frame, dump.name)
        with np.errstate(all="ignore"):  # overflowing numbers, which the comparison judges
            audit.take(frame)
    audit.end(str(dump), rest)
    case = findings.case(case_name(dump))
    case.about = "a dump of your input deck: its columns against each other, at the end of a step"
    leave_unchecked(case, audit.unchecked())
    case.out_of_scope = fields.out_of_scope(audit.reasons)
    words = ["--dump", str(dump), "--deck", str(deck), *options.words()]
    case.source, case.reproduce = str(dump), shlex.join(["eos-ref", "audit", *words])
    case.seconds = Seconds(reference=time.perf_counter() - begin, total=time.perf_counter() - begin)
    record = RunRecord(engine=EngineRecord(), reference={}, cases=[case], seconds=case.seconds.total).counted()
    return AuditResult(record, findings.who, audit.arrays)


def _read(dump: Path) -> tuple[list[FileSnapshot], list[str]]:
    """Return the complete snapshots, and a line on how the file ends."""
    every: list[FileSnapshot] = []
    rest: list[str] = []
    try:
        every.extend(snapshots(dump))
    except CutOff as error:
        if not every:
            raise error.at(str(dump)) from None
        rest = [f"the dump is cut off after step {every[-1].step}: not judged is the rest, {error.found}"]
    except InputError as error:
        raise error.at(str(dump)) from None
    if not every:
        raise InputError("dump", "must hold a snapshot", where=str(dump))
    for name in ("id", "type"):
        if name not in every[0].columns:
            raise InputError("columns", f"must hold {name}", " ".join(every[0].columns), str(dump))
    return every, rest


def _run(number: int, setup: RunSetup) -> Run:
    try:
        return Run(number, setup, setup.model())
    except InputError as error:
        return Run(number, setup, error)


def _frame(snapshot: FileSnapshot, runs: Sequence[Run], where: str) -> Frame:
    """Find the run of a snapshot: at the step between two runs the first, if the dump was defined by then.

    ``runs`` are those that can have written it.
    """
    within = [run for run in runs if run.setup.first <= snapshot.step <= run.setup.last]
    if not within:
        steps = ", ".join(f"{run.setup.first} to {run.setup.last}" for run in runs)
        raise InputError(
            "step", f"must be one of the runs of the deck that write it (steps {steps})", snapshot.step, where
        )
    ended = [run for run in within if run.setup.first < snapshot.step]
    return Frame(snapshot, (ended or within)[0], not ended)


def _check(frame: Frame, where: str) -> None:
    """Reject a snapshot whose particles do not belong to the deck.

    Raises
    ------
    InputError
    """
    id_n, type_n = (frame.snapshot.numbers(name, int) for name in ("id", "type"))
    place, types = f"{where}, step {frame.snapshot.step}", frame.run.setup.ntypes
    if len(np.unique(id_n)) != len(id_n):
        raise InputError("id", "must differ from particle to particle", where=place)
    wrong_n = type_n[(type_n < 1) | (type_n > types)]
    if len(wrong_n):
        raise InputError("type", f"must lie within 1 to {types}", int(wrong_n[0]), place)


def _coarse(x_nc: Rounded, model: Model) -> str:
    """Return why neighbours do not follow from positions; or nothing."""
    if not np.isfinite(x_nc.value).all():
        return "positions are not numbers"
    # Beyond the latter, the cutoff no longer distinguishes the squares of distances, whatever the digits.
    known = 2 * np.sqrt(model.dimension) * x_nc.error.max(initial=0.0) + EPS * np.abs(x_nc.value).max(initial=0.0)
    return "" if known < 0.5 * model.cut else "positions are not known to within the cutoff"


def _writing(dump: DeckDump, runs: Sequence[Run]) -> list[Run]:
    """Return the runs that can have written a dump; write_dump shows the state after the run before it."""
    if dump.step is not None:
        return [run for run in runs if run.number <= max(dump.begin, 1)]
    return [run for run in runs if dump.begin < run.number <= dump.end]


class _Audit:
    """Takes the snapshots, one by one."""

    def __init__(self, columns: dumps.DumpColumns, options: AuditOptions, findings: Findings) -> None:
        self.columns, self.options, self.findings = columns, options, findings
        self.whole = dumps.whole(columns.dump)
        self.listed = known(findings.who["distribution"])
        self.explained: Explained = {}
        self.reasons: dict[tuple[str, str], list[int]] = {}
        self.steps: list[int] = []
        self.arrays: dict[str, npt.NDArray[Any]] = {}

    def take(self, frame: Frame) -> None:
        """Check one snapshot."""
        run, snapshot = frame.run, frame.snapshot
        self.steps.append(snapshot.step)
        held = self.columns.read(snapshot, run.setup.dimension)
        self.findings.broke = self.findings.broke or _broke(snapshot, run.number)
        names, unchecked = self._choice(frame, held)
        for name, reason in unchecked.items():
            self.reasons.setdefault((name, reason), []).append(snapshot.step)
        setup = run.setup
        laws = run.model.eos.laws if isinstance(run.model, Model) else ()
        melts = isinstance(run.model, Model) and any(of.T_freeze is not None for of in run.model.thermal or ())
        mass_t: list[Any] = setup.mass_t or [None] * (len(laws) + 1)
        records = [LawRecord.of(t, law, mass_t[t], melts) for t, law in enumerate(laws, 1)]
        stages: dict[str, str] = {name: FIELDS[name].stage for name in names}
        id_n = snapshot.numbers("id", int)
        facts = RunFacts(len(id_n), setup.dimension, setup.units, records, [], run.number, {}, stages, derived(0))
        self.findings.take(facts)
        if not names or not len(id_n):
            return
        sample = _sample(frame, held, id_n)
        shown = {name: held[name].value for name in names}
        dumps = Printed(FrameEvaluation, {name: held[name].error for name in names})
        found = judged(sample, names, id_n, shown, self.listed, self.explained, printed=dumps)
        compared, self.explained = found.comparisons, found.explained
        open_ = {name: tuple(entry.id for entry in entries) for name, entries in found.unpredictable.items()}
        rows = {(name, 0): SampleRow.of(len(c.bound_n), c.record) for name, c in compared.items()}
        for name in names:
            left = len(id_n) - len(compared[name].bound_n) if name in compared else len(id_n)
            if left and name not in open_:
                some = f"{left} of {wording.counted(len(id_n), 'particle')} {OPEN}"
                reason = NO_PARTICLE if left == len(id_n) else some
                self.reasons.setdefault((name, reason), []).append(snapshot.step)
        if self.findings.blame is None:  # of the first snapshot in which a field differs, else of the last one
            self.arrays = _arrays(sample, snapshot, id_n, compared)
        known = {"x", "v", "rho"} | ({"energy"} if sample.model.thermal else set())
        doubled = len(self.steps) & (len(self.steps) - 1) == 0  # the 1st, 2nd, 4th, ... snapshot
        looked = doubled and held.keys() >= known and not _coarse(held["x"], sample.model)
        found_here = effects(sample, self.findings.who["distribution"], run.number, snapshot.step) if looked else []
        self.findings.take(
            SampleRows(snapshot.step, run.number, snapshot.step, rows, tuple(found_here), unpredictable=open_)
        )

    def _choice(self, frame: Frame, held: dict[str, Any]) -> tuple[list[str], dict[str, str]]:
        names, unchecked = [], {}
        for name in fields.checked():
            if reason := self._why_not(name, frame, held):
                unchecked[name] = reason
            elif fields.ALL in self.options.fields or name in self.options.fields:
                names.append(name)
        return names, unchecked

    def _why_not(self, name: str, frame: Frame, held: dict[str, Any]) -> str:
        run, model = frame.run, frame.run.model
        if isinstance(model, InputError):
            return str(model)
        if fields.absent(name, model):
            return fields.ABSENT
        if name not in held:
            return {"f": NO_FORCES, "drho": NO_RATE}.get(name, NO_COLUMN)
        given = held.keys() | ({"mass"} if run.setup.mass_t is not None else set())
        if reason := dumps.lacking(name, model, given, frame.set_up, self.whole):
            return reason
        by_sums = fields.needs(name, "pairs", model) and not dumps.by_columns(name, held)
        if by_sums and (reason := _coarse(held["x"], model)):
            return reason
        if dumps.by_columns(name, held) or (name != "rho" and not fields.needs(name, "pairs", model)):
            return ""
        open_tilt = fields.leans_open(frame.snapshot.tilt, frame.snapshot.periodic)
        deck = run.setup.deck
        forces = f"{deck.elastic_styles()[0]} adds to it" if deck.elastic_styles() else deck.acts_on_forces()
        setting = fields.Setting(deck, run.setup.units, open_tilt, run.setup.between, False, forces, deck.adds_heat())
        if reason := fields.why_not(name, model, setting):
            return reason
        if frame.set_up:
            return ""
        if run.setup.units in ("real", "metal", "electron"):
            return f"in units {run.setup.units} force over mass is not an acceleration"
        return run.setup.deck.moves_on()

    def unchecked(self) -> dict[str, str]:
        """Return by field why it was not checked, with the steps if that concerns only some snapshots."""
        lines = []
        for (name, reason), steps in self.reasons.items():
            some = f" (steps {', '.join(map(str, steps[:5]))}{', ...' * (len(steps) > 5)})"
            lines.append((name, reason + some * (len(steps) < len(self.steps))))
        return by_field(lines)

    def end(self, file: str, rest: Sequence[str] = ()) -> None:
        """Complete the record after the last snapshot of a file."""
        if not self.findings.checks and self.findings.broke is None:
            missing = [name for name, reason in self.reasons if reason in (NO_COLUMN, NO_FORCES, NO_RATE)]
            others = [f"{name}: {reason}" for name, reason in self.reasons if name not in missing]
            why = f"it lacks {', '.join(missing)}: see compute rheo/property/atom" if missing else "; ".join(others[:3])
            raise InputError("dump", f"must hold columns that can be checked against each other; {why}", where=file)
        runs = len({check.run for check in self.findings.checks})
        acting = self.findings.ended.acting if self.findings.ended else []
        self.findings.take(DeckEnd(max(self.steps), runs, Seconds(), list(rest), [], {}, {}, acting=acting))


def _broke(snapshot: FileSnapshot, run: int) -> BreakRecord | None:
    """Return where a snapshot holds a number that is not finite: the particle of least id, its first such column."""
    id_n = snapshot.numbers("id", int)
    bad = {name: ~np.isfinite(values_n) for name, values_n in _numbers(snapshot)}
    found = [(int(id_n[bad_n].min()), k, name) for k, (name, bad_n) in enumerate(bad.items()) if bad_n.any()]
    if not found:
        return None
    atom, _, column = min(found)
    return BreakRecord(
        kind="not a number", run=run, step=snapshot.step, column=column, atom=atom,
        value=float(snapshot.numbers(column)[id_n == atom][0]), particles=int(bad[column].sum()), of=len(id_n),
        both=False,
    )  # fmt: skip


def _numbers(snapshot: FileSnapshot) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the columns that hold numbers, without others such as element."""
    for name in snapshot.columns:
        with contextlib.suppress(InputError):
            yield name, snapshot.numbers(name)


def _sample(frame: Frame, held: dict[str, Any], id_n: npt.NDArray[Any]) -> FrameSample:
    run, snapshot = frame.run, frame.snapshot
    model, setup = run.model, run.setup
    assert isinstance(model, Model)
    type_n = snapshot.numbers("type", int)
    place = {number: k for k, number in enumerate(setup.id_n.tolist())}
    at_n = np.array([place.get(number, -1) for number in id_n.tolist()])
    mass_n = held["mass"] if setup.mass_t is None else np.array(setup.mass_t)[type_n]
    solid_n = _solid(held, setup, at_n)
    held = held | {"mass": Rounded(value(mass_n), error(mass_n))}
    state = dumps.state_of_forces(held, model, type_n, solid_n, setup.dt, frame.set_up)
    d = model.dimension
    tilt = snapshot.tilt[: d * (d - 1) // 2] if any(snapshot.tilt) else ()
    box = Box(tuple(snapshot.low_c[:d]), tuple(snapshot.high_c[:d]), snapshot.periodic[:d], tilt)
    both = model.fix.rho_sum and model.fix.interface_reconstruct
    return FrameSample(
        model, box, dumps.plain(state), value(mass_n),
        [(action, setup.members[action.group][at_n] & (at_n >= 0)) for action in run.setup.deck.plain_actions()],
        frame.set_up and both,
        snapshot.numbers("z") if d == 2 and "z" in snapshot.columns else None,
        unlists_bonded=run.setup.deck.unlists_bonded,
        newton=setup.newton,
        ranks=setup.ranks,
        of_forces=state,
        at_end={name: held[name] for name in ("rho", "energy") if name in held},
        gradient_ncc=held.get("grad/v"),
    )  # fmt: skip


def _solid(held: dict[str, Any], setup: RunSetup, at_n: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Return which particles are solid, by the dump, else at the beginning of the run."""
    if "phase" in held:
        return np.asarray(held["phase"].value != 0)
    if "status" in held:
        return np.asarray(held["status"].value.astype(int) & SOLID != 0)
    return np.asarray(setup.solid_n[at_n] & (at_n >= 0))


def _arrays(
    sample: FrameSample, snapshot: FileSnapshot, id_n: npt.NDArray[Any], compared: dict[str, Comparison]
) -> dict[str, npt.NDArray[Any]]:
    order_n, s = np.argsort(id_n, kind="stable"), sample.state
    arrays = {"id": id_n, "type": s.type_n, "x": s.x_nc, "v": s.v_nc, "rho": s.rho_n, "mass": sample.mass_n}
    for name, c in compared.items():
        if len(c.bound_n) == len(id_n):
            arrays |= {f"{name}.lammps": c.lammps_n, f"{name}.reference": c.reference_n, f"{name}.bound": c.bound_n}
    box_c = np.array([snapshot.low_c, snapshot.high_c, *[snapshot.tilt] * any(snapshot.tilt)])
    sorted_n = {name: array[order_n] for name, array in arrays.items()}
    return sorted_n | {"box": box_c, "periodic": np.array(snapshot.periodic), "step": np.array(snapshot.step)}
