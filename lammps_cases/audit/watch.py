"""The hook into LAMMPS' runs: samples of the state right after a force evaluation, with the laws of that moment.

A ``fix external`` behind the deck's own fixes calls back after the forces: there, the state and all that was made of it
belong to one and the same evaluation. At the end of a step they do not (density has moved on by half a step).
"""

from __future__ import annotations

import copy
import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref import EOSTable
from eos_ref.eos import bounds
from eos_ref.errors import InputError
from eos_ref.evaluation.pairs import Candidates, sharing
from eos_ref.model.parameters import Model
from eos_ref.numbers.rounded import value
from eos_ref.syntax.manual import manual_of
from lammps_cases.audit import fields, pressure, sample, share
from lammps_cases.audit.budgets import budget
from lammps_cases.audit.deck import Action, Deck, between, hyphens
from lammps_cases.audit.effects import Acting, Explained, effects, of_pressure, touching
from lammps_cases.audit.evaluation import ParticleSample, model_with_forces
from lammps_cases.audit.fields import leans_open
from lammps_cases.audit.health import Good, Health, mach, outlook
from lammps_cases.audit.messages import PairShare, RunFacts, SampleRow, SampleRows
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.pressure import PressureSample
from lammps_cases.audit.rerun import closed, looks, reruns, shortened
from lammps_cases.audit.warn import SOLID, Kept, Questions
from lammps_cases.comparison.compare import Comparison
from lammps_cases.records.audit_record import BudgetRecord, ClosedRecord, EffectRecord, OutlookRecord, SeriesRecord
from lammps_cases.records.run_record import FieldRecord, LawRecord
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict.model_fields import derived
from lammps_cases.verdict.runaway import RUNAWAY

Array = npt.NDArray[Any]
Compared = tuple[PressureSample, dict[str, Comparison], bool]  # see `PressureSample.result`
FIX = "eosref_audit"
NEVER = 2**31 - 1  # steps between two uses of the callback's forces


@dataclass(frozen=True)
class WatchedRun:
    """A run command that is being audited.

    Attributes
    ----------
    first : step at which it begins
    stop : step at which the audit ends, if it is to end before the deck
    continued : whether it begins without a set-up
    table : laws of its types; None: it evaluates no pressure
    mass_t : mass per type, from index 1; None where every particle has its own
    actions : fixes that change forces by plain numbers
    choice : what is checked
    sampler : of the fields beside the pressure, if any is checked
    deck : the commands at its beginning
    shared : what adds to the forces of pair_style rheo, if a second deck can be asked for these alone
    steps : that it takes
    """

    first: int
    stop: int | None
    continued: bool
    table: EOSTable | None
    mass_t: Array | None
    actions: list[Action]
    choice: fields.Choice
    sampler: sample.Sampler | None
    deck: Deck
    shared: str
    steps: int


class DeckWatch:
    """Keeps the deck's fixes, sets up the samples before every run, and counts steps.

    Parameters
    ----------
    lmp : lammps
        An open instance.
    options : AuditOptions
        Steps between two samples, steps to do, and fields.
    send : callable
        Given a `RunFacts` at the start of every run and `SampleRows` at every sample.
    engine : str
        Version of the distribution, for the ledger.
    """

    def __init__(self, lmp: Any, options: AuditOptions, send: Callable[[object], None], engine: str = "") -> None:
        self.lmp, self.options, self.send, self.engine = lmp, options, send, engine
        self.deck = Deck()
        self.questions, self.health, self.acting = Questions(), Health(), Acting(engine)
        self.runs = self.done = 0
        self.lammps_seconds = self.sample_seconds = 0.0
        self._run: WatchedRun | None = None
        self._last: Compared | None = None  # the last sample
        self._differing: Compared | None = None  # the first one in which a field differs
        self._previous: int | None = None  # step of the last call
        self._good: Good | None = None  # the last sample that looks like a fluid, if the deck's forces are known
        self._first: Good | None = None  # the first sample of the last run, if it looks so
        self._harmful: set[str] = set()  # findings that change a field that steps need, in some sample
        self._judged = 0  # samples that looked so
        self._fluid = 0  # atoms in the run's samples, as long as all looked so
        self.kept: dict[int, dict[str, Array]] = {}  # by step, the first and the last sample of the first run
        self.thermo: list[dict[str, float]] = []
        self._broke_off: int | None = None  # step at which LAMMPS ended a run
        self._failure: BaseException | None = None
        self._shared: tuple[Any, ...] | None = None  # of the last sample that looks like a fluid; see `share`
        self._near: list[Candidates] = []  # pairs of all evaluations, as long as particles have hardly moved
        self._open: Explained = {}  # by field of the last good sample, findings that cannot be evaluated

    def heed(self, values: list[str]) -> None:
        """Take down what LAMMPS will not do as a command that it is about to execute says."""
        if words := hyphens(values):
            self.questions.misread(values, words)
        if values[0] == "suffix":
            styles = [word for word in values[1:] if word not in ("on", "off", "hybrid")]
            lacking = [style for style in styles if not self.lmp.has_style("pair", f"rheo/{style}")]
            if lacking:
                self.questions.suffixed(lacking)

    def note(self, values: list[str]) -> None:
        """Take down a command that LAMMPS has executed."""
        rheo = self.deck.fix("rheo")
        self.deck.note(values)
        if self.deck.fix("rheo") is not rheo:
            sample.drop(self.lmp)
        for each in (self.questions, self.health, self.acting):
            each.note(values)

    def run(self, values: list[str], execute: Callable[..., None]) -> bool:
        """Execute a run command with samples; return whether the audit has done all the steps it was to do."""
        self.runs += 1
        first = self._step()
        if self.lmp.extract_setting("box_exist"):
            self.health.begin(int(self.lmp.get_natoms()))
            self.begin(values)
        sampled, begin = self.sample_seconds, time.perf_counter()
        try:
            execute()
        except Exception as error:  # LAMMPS' errors have no type of their own; all are raised again
            self._broke_off = self._step()
            self.health.ended(str(error), self.runs, self._broke_off)
            raise
        finally:
            self.lammps_seconds += time.perf_counter() - begin - (self.sample_seconds - sampled)
            self.done += self._step() - first
            pressure.take_thermo(self.lmp, self.thermo)
            if self.runs == 1 and self._last is not None:
                self.kept[self._last[0].step] = pressure.columns(*self._last)
            if self._run is not None:  # a minimization calls back too, but evaluates no pressure
                self._run = replace(self._run, table=None)
        if self._failure is not None:
            raise self._failure
        return self.options.steps is not None and self.done >= self.options.steps

    def _step(self) -> int:
        return int(self.lmp.extract_global("ntimestep"))

    def begin(self, values: list[str]) -> None:
        """Set up the samples of a run command, and send its facts."""
        lmp, first, steps = self.lmp, self._step(), self.options.steps
        try:
            table = self.deck.laws(int(lmp.extract_setting("ntypes")))
        except InputError as error:
            raise self.acting.accepted(error) from None
        if table is None:
            self.questions.unwatched(self.runs)
        else:
            pressure.load_compiled(table)
        mass_t = None if lmp.extract_atom("rmass") else np.array(lmp.numpy.extract_atom("mass"))
        stop = None if steps is None else first + steps - self.done
        self._previous = None
        if self._run is not None and ("pre", "no") in itertools.pairwise(values) and lmp.has_id("fix", FIX):
            # A new fix, or compute, would need the set-up that such a run leaves out.
            self._run = replace(
                self._run,
                first=first,
                stop=stop,
                continued=True,
                table=table,
                mass_t=mass_t,
                steps=_steps(values, first),
            )
        else:
            sample.drop(lmp)
            choice, sampler, actions = fields.Choice((), {}), None, self.deck.plain_actions()
            if table is not None:
                choice, sampler = self._choose(table, mass_t, actions, values)
            shared = self._added(choice) if sampler is not None else ""
            deck = copy.deepcopy(self.deck)
            count = _steps(values, first)
            self._run = WatchedRun(first, stop, False, table, mass_t, actions, choice, sampler, deck, shared, count)
            if lmp.has_id("fix", FIX):
                lmp.command(f"unfix {FIX}")
            # Called on the steps to sample, on the first one, and on the last one that the audit is to do.
            apart = math.gcd(self.options.every, first, stop or 0)
            lmp.command(f"fix {FIX} all external pf/callback {apart} {NEVER}")
            lmp.set_fix_external_callback(FIX, self._called, None)
        self.send(self._facts(self._run))

    def _choose(
        self, table: EOSTable, mass_t: Array | None, actions: list[Action], values: list[str]
    ) -> tuple[fields.Choice, sample.Sampler | None]:
        """Choose what is checked in the run that begins."""
        if self.options.fields == fields.PRESSURE:
            return fields.Choice(fields.PRESSURE, {}), None
        model = self._model(table, mass_t)
        _, _, xy, yz, xz, periodic, _ = self.lmp.extract_box()
        open_tilt = leans_open((xy, xz, yz), periodic)
        units = str(self.lmp.extract_global("units"))
        massless = mass_t is None and any(periodic) and not self.deck.keeps_masses()
        setting = fields.Setting(self.deck, units, open_tilt, between(values), massless)
        choice = fields.choose(self.options.fields, model, setting)
        if not isinstance(model, Model) or choice.fields == fields.PRESSURE:
            return choice, None
        unlists = self.deck.unlists_bonded
        return choice, sample.Sampler(self.lmp, choice.fields, model, actions, mass_t, self.engine, unlists)

    def _added(self, choice: fields.Choice) -> str:
        """Return what adds to the forces, if that alone is why they are left out and the share of rheo can be had."""
        added = self.deck.adds_force() if choice.unchecked.get("f") == self.deck.adds_force() else ""
        own_masses = bool(self.lmp.extract_atom("rmass"))
        return added if share.can_be_asked(self.deck) and not own_masses else ""

    def share(self) -> PairShare | None:
        """Return the deck of pair_style rheo alone for the last sample, where others add to its forces."""
        return None if self._shared is None else share.share(*self._shared)

    def _model(self, table: EOSTable, mass_t: Array | None) -> Model | InputError:
        of_types = self.lmp.numpy.extract_atom("mass") if mass_t is None else mass_t  # some laws of LAMMPS use these
        mass = [1.0] * len(table) if of_types is None else [m or 1.0 for m in of_types[1:].tolist()]
        try:
            manual = manual_of(str(self.lmp.version()))
            return self.deck.model(int(self.lmp.extract_setting("dimension")), len(table), mass, table, manual)
        except InputError as error:
            if table.needs_energy:
                self.acting.gas()
            return self.acting.accepted(error)

    def _facts(self, run: WatchedRun) -> RunFacts:
        laws = () if run.table is None else run.table.laws
        mass_t = [None] * (len(laws) + 1) if run.mass_t is None else run.mass_t.tolist()
        melts = "Tfreeze" in (self.deck.fix("rheo/thermal") or ())
        return RunFacts(
            int(self.lmp.get_natoms()),
            int(self.lmp.extract_setting("dimension")),
            str(self.lmp.extract_global("units")),
            [LawRecord.of(t, law, mass_t[t], melts) for t, law in enumerate(laws, 1)],
            [bounds.comparison_derivation(law) for law in laws],
            self.runs,
            run.choice.unchecked if laws else {},
            {field: FIELDS[field].stage for field in run.choice.fields},
            derived(0),
        )

    def _called(self, caller: object, step: int, n: int, tag_n: Array, x_nc: Array, force_nc: Array) -> None:
        begin = time.perf_counter()
        force_nc.fill(-0.0)  # the one addend that changes no bit, not even of a force of -0.0
        run = self._run
        assert run is not None
        try:
            pressure.take_thermo(self.lmp, self.thermo)
            if run.table is not None and (step % self.options.every == 0 or step in (run.first, run.stop)):
                id_n = pressure.ids(self.lmp)
                with sharing(self._near):
                    self._sample(run, run.table, int(step), id_n, pressure.atoms(self.lmp, "x", len(id_n)))
            self._previous = int(step)
        except BaseException as error:  # ctypes would print and forget it
            self._failure = error
        if self._failure is not None or step == run.stop:
            self.lmp.force_timeout()
        self.sample_seconds += time.perf_counter() - begin

    def _sample(self, run: WatchedRun, table: EOSTable, step: int, tag_n: Array, x_nc: Array) -> None:
        n, sampler = len(tag_n), run.sampler
        now = pressure.read(self.lmp, table, run.mass_t, step, tag_n, x_nc)
        status_n = pressure.atoms(self.lmp, "rheo_status", n)
        # A run calls back twice on one step where it is set up anew, in between (run ... every).
        setup = not run.continued and step in (run.first, self._previous)
        state = {name: now.arrays[name] for name in ("x", "v", "rho", "energy") if name in now.arrays}
        fluid = self.health.state(self.runs, step, now.arrays["id"], state, step == run.first) and n > 0
        taken = self._taken(run, table, step, tag_n, x_nc, setup) if fluid else None
        others, unpredictable = dict[str, Comparison](), Explained()
        if sampler is not None and taken is not None:
            if mach(taken.model, taken.state) > RUNAWAY:  # neighbour lists are not made for particles that move so far
                self.questions.run_away(self.runs, step)
            else:
                others, unpredictable = self._compare(sampler, step, tag_n)
        if setup and self.deck.sums_walls():  # LAMMPS then shows other densities of walls than it used (see the ledger)
            fluid_n = status_n & SOLID == 0
            now, status_n = now.of(fluid_n), status_n[fluid_n]
        if others and sampler is not None and run.shared:
            units = str(self.lmp.extract_global("units"))
            self._shared = run.deck, sampler.last, tag_n.copy(), now.box_c, units, run.shared, self.runs, step
        checked = "pressure" in run.choice.fields
        finite_n = np.isfinite(now.arrays["rho"]) & np.isfinite(now.arrays.get("energy", 0.0))
        if not finite_n.all():  # no law has a pressure for what is no number
            now, status_n = now.of(finite_n), status_n[finite_n]
        self._last = now, others, checked
        if self.runs == 1 and step == run.first:
            self.kept[step] = pressure.columns(*self._last)
        rows = {}
        for t, (of_type, comparison) in now.compare().items():
            rho_n, p_n = now.arrays["rho"][of_type], now.arrays["p"][of_type]
            self.questions.take(t, table[t], status_n[of_type], rho_n, p_n)
            if checked:
                if comparison.record.verdict == "differs" and sampler is not None and taken is not None:
                    sampler.explain_pressure(tag_n, self.lmp.numpy.extract_atom("pressure")[:n], comparison.record)
                rows["pressure", t] = SampleRow.of(rho_n.size, comparison.record)
        rows |= {(field, 0): SampleRow.of(len(c.bound_n), c.record) for field, c in others.items()}
        order = fields.offered()
        rows = dict(sorted(rows.items(), key=lambda item: (order.index(item[0][0]), item[0][1])))
        looked_at = taken if others or sampler is None else None
        of_findings = self._look_ahead(run, step, tag_n, looked_at, unpredictable)
        budgets = self._budget(run, step, setup, bool(of_findings))
        open_ = {field: tuple(entry.id for entry in entries) for field, entries in unpredictable.items()}
        self.send(SampleRows(step, self.runs, self.done + step - run.first, rows, of_findings, budgets, open_))
        if self._differing is None and any(row.verdict == "differs" for row in rows.values()):
            self._differing = self._last

    def _taken(
        self, run: WatchedRun, table: EOSTable, step: int, tag_n: Array, x_nc: Array, setup: bool
    ) -> ParticleSample | None:
        """Return the particles of a sample, and look at what is questionable in them; None without a model."""
        if run.sampler is not None:
            taken = run.sampler.take(len(tag_n), x_nc, setup)
        else:
            model = self._model(table, run.mass_t)
            if not isinstance(model, Model):
                return None
            taken = sample.taken(self.lmp, model, run.actions, run.mass_t, len(tag_n), x_nc)
        first = step == run.first
        self.health.fluid(self.runs, step, tag_n, taken.model, taken.state, bool(run.deck.adds_heat()), first)
        if first and fields.ALL in self.options.fields:
            self.acting.begin(self.lmp, self.deck, taken, run.steps, not run.continued)
        if mach(taken.model, taken.state) <= RUNAWAY:
            timestep = float(self.lmp.extract_global("dt"))
            self.questions.look(Kept(self.runs, step, timestep, taken, tag_n.copy(), first))
            self.questions.stillness.look(step, tag_n, taken, first)
        return taken

    def _compare(self, sampler: sample.Sampler, step: int, tag_n: Array) -> tuple[dict[str, Comparison], Explained]:
        shown = sampler.shown(len(tag_n))
        found = sampler.compare(tag_n, shown)
        reference = {name: np.asarray(value(found.reference.output(name)), float) for name in shown}
        self.health.fields(self.runs, step, tag_n, shown, reference)
        self.questions.tilted = max(self.questions.tilted, sampler.tilted)
        return found.comparisons, found.unpredictable

    def _look_ahead(
        self, run: WatchedRun, step: int, tag_n: Array, now: ParticleSample | None, unpredictable: Explained
    ) -> tuple[EffectRecord, ...]:
        """Keep a sample slower than sound; of the 1st, 2nd, 4th, 8th ... return what findings do to it."""
        count = 0 if now is None or run.sampler is None else len(now.mass_n)
        if step == run.first:
            self._fluid = count
        if now is None or count < self._fluid or mach(now.model, now.state) > 1 or run.sampler is None:
            self._fluid = count + 1  # what is left of a run that lost particles, or its measure, may look well again
            return ()
        if self.health.broke is None or self._good is None:
            if "f" in run.choice.fields:
                self._good = Good(now, float(self.lmp.extract_global("dt")), self.runs, step, tag_n.copy())
                if self._first is None or self._first.run != self.runs:
                    self._first = self._good
            self._open = unpredictable | _undefined(run.sampler.explained)
        self._judged += 1
        doubled = self._judged & (self._judged - 1) == 0
        seen = {entry.id for entries in run.sampler.explained.values() for entry in entries}
        look = doubled or not seen <= self._harmful
        harmful = tuple(effects(now, self.engine, self.runs, step, run.sampler.evaluated, seen)) if look else ()
        self._harmful |= seen
        self._harmful |= {effect.finding for effect in harmful}
        return harmful

    def _budget(self, run: WatchedRun, step: int, setup: bool, with_findings: bool) -> tuple[BudgetRecord, ...]:
        """Return the conserved quantities of a sample if they are asked for, and the forces of all pairs are known."""
        now = run.sampler.last if run.sampler else None
        if not self.options.budgets or now is None or "f" not in run.choice.fields:
            return ()
        if mach(now.model, now.state) > RUNAWAY:
            return ()
        force_nc = pressure.atoms(self.lmp, "f", len(now.mass_n))[:, : now.model.dimension]
        half_step = 0.0 if setup else 0.5 * float(self.lmp.extract_global("dt"))
        entries = touching(now, self.engine) if with_findings else ()
        of_press = of_pressure(now, self.engine) if setup else []
        return (budget(now, force_nc, self.runs, step, half_step, entries, of_press),)

    def series(self) -> tuple[list[SeriesRecord], ClosedRecord | None]:
        """Return runs of the reference from the first sample of the last run, if asked for and all forces are known.

        With what a closed solution says of the same steps, where there is one.
        """
        if not self.options.budgets or self._first is None or self._good is None:
            return [], None
        steps = self._good.step - self._first.step
        entries = [entry for entry in touching(self._good.sample, self.engine) if entry.id in self._harmful]
        series = reruns(self._first, steps, self.options.every, entries)
        return series, closed(self._first, looks(steps, self.options.every)) if series else None

    def unbudgeted(self) -> list[str]:
        """Say why there is no budget, or no run of the reference, though budgets are asked for."""
        if not self.options.budgets or self.options.fields == fields.PRESSURE:
            return []
        if self._good is None:
            return ["--budgets: nothing is followed, as forces are not compared in any run"]
        if model_with_forces(self._good.sample) is None:
            groups = ", ".join(dict.fromkeys(f"{a.style} on {a.group}" for a, _ in self._good.sample.actions))
            why = f"forces act on groups that are not of types ({groups})"
            return [f"--budgets: the reference does not run on from the first look, as {why}"]
        steps = self._good.step - self._first.step if self._first else 0
        short = shortened(len(self._good.id_n), steps)
        return (
            [f"--budgets: the reference takes fewer than {steps} steps, as particles are many: {short}"]
            if short
            else []
        )

    def outlook(self) -> tuple[OutlookRecord | None, list[EffectRecord]]:
        """Return why the state broke or LAMMPS ended a run before its time; nothing if neither, or if nobody knows."""
        broke = self.health.broke
        brief, lost = self.questions.brief, self.health.lost
        if broke is not None and broke.given:
            given = f"run {broke.run} begins with {broke.column} = {broke.value} of atom {broke.atom}"
            return OutlookRecord(cause="set-up", because=given, run=broke.run, step=broke.step, taken=0, steps=0), []
        if lost is not None and not lost.ignored and self._broke_off is None:
            self._broke_off = lost.step
        if broke is not None and brief and (broke.both or self._good is None):
            return OutlookRecord(cause="set-up", because=brief, run=broke.run, step=broke.step, taken=0, steps=0), []
        if self._good is None or (broke is None and self._broke_off is None):
            return None, []
        at = broke.step if broke is not None and broke.run == self._good.run else self._broke_off or self._good.step
        record, more = outlook(self._good, self.engine, at - self._good.step, brief, self._open.get("f", ()))
        grown = broke is not None and broke.column == "energy" and broke.kind == "runaway" and self._broke_off is None
        if grown and (record is None or record.cause == "not understood"):
            self.health.broke = None  # something heats the deck that is not followed
            return None, []
        return record, more

    def final(self) -> tuple[dict[str, Array], dict[int, FieldRecord]]:
        """Return arrays by id, and the pressure's fields per type in the last sample with the digits lost.

        The arrays are those of the first sample in which a field differs, which shows more than what a run that has
        blown up ends with; of the last one if none does.
        """
        if self._last is None:
            return {}, {}
        arrays, records = _result(self._last)
        return (arrays if self._differing is None else _result(self._differing)[0]), records


def _undefined(explained: Explained) -> Explained:
    """Return, of the findings that explain fields, those that leave some particles open."""
    of = {
        name: [e for e in entries if e.model_variant and e.model_variant.undefined]
        for name, entries in explained.items()
    }
    return {name: entries for name, entries in of.items() if entries}


def _steps(values: list[str], first: int) -> int:
    """Return how many steps a run command takes; 0 if that is not a number."""
    count = int(float(values[1])) if len(values) > 1 and values[1].replace(".", "", 1).isdigit() else 0
    return max(count - first, 0) if "upto" in values else count


def _result(compared: Compared) -> tuple[dict[str, Array], dict[int, FieldRecord]]:
    now, others, checked = compared
    return now.result(others, checked)
