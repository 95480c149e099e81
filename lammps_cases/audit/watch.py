"""The hook into LAMMPS' runs: samples of the state right after a force evaluation, with the laws of that moment.

A ``fix external`` behind the deck's own fixes calls back after the forces: there, the state and all that
follows from it belong to the same evaluation. At the end of a step they do not (density has moved on by half a step).
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
from lammps_cases.audit import arrays, fields, sample, share
from lammps_cases.audit.arrays import PressureSample
from lammps_cases.audit.budgets import budget
from lammps_cases.audit.deck import UNPREPARED, Action, Deck, between, hyphens
from lammps_cases.audit.effects import Acting, Explained, of_pressure, touching
from lammps_cases.audit.evaluation import ParticleSample, TimedSample
from lammps_cases.audit.fields import leans_open
from lammps_cases.audit.messages import PairShare, RunFacts, SampleRow, SampleRows
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.outlook import FluidSamples, Health, mach
from lammps_cases.audit.warn import SOLID, Questions
from lammps_cases.comparison.compare import Comparison
from lammps_cases.records.case_parts import BudgetRecord, FieldRecord, LawRecord
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict.model_fields import derived
from lammps_cases.verdict.runaway import RUNAWAY

Array = npt.NDArray[Any]
FIX = "eosref_audit"
FIRST_FIX = "eosref_first"  # before the deck's own: there, forces and heat flows are those of pairs and bonds alone
NEVER = 2**31 - 1  # steps between two uses of the callback's forces


@dataclass(frozen=True)
class WatchedRun:
    """A run command that is being audited.

    Attributes
    ----------
    first : step at which it begins
    stop : step at which the audit ends, if before the deck
    continued : whether it begins without a set-up
    table : laws of its types; None: no pressure is evaluated
    mass_t : mass per type, from index 1; None where every particle has its own
    actions : fixes that change forces by plain numbers
    choice : what is checked
    sampler : of the fields other than the pressure, if any is checked
    deck : the commands at its beginning
    shared : what adds to the forces of pair_style rheo, if a second deck can evaluate these alone
    steps : number that it takes
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
    """Keeps the deck's fixes, sets up the samples before every run, takes them, and counts steps.

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
        self.fluid = FluidSamples(options, engine)
        self.runs = self.done = 0
        self.lammps_seconds = self.sample_seconds = 0.0
        self._run: WatchedRun | None = None
        self._waiting = ""  # the first command since the last set-up that needs another one
        self._last: PressureSample | None = None  # the last sample
        self._differing: PressureSample | None = None  # the first sample in which a field differs
        self._explained: PressureSample | None = None  # the first one in which a known bug shows
        self._previous: int | None = None  # step of the last call
        self.kept: dict[int, dict[str, Array]] = {}  # by step, the first and the last sample of the first run
        self.thermo: list[dict[str, float]] = []
        self._failure: BaseException | None = None
        self._shelled: Array | None = None  # ids of the particles in bonds of fix rheo/oxidation in the step before
        self._of_pairs: dict[str, Array] = {}  # forces and heat flows of a sample before fixes change them
        self._shared: tuple[Any, ...] | None = None  # of the last sample that looks like a fluid; see `share`
        self._near: list[Candidates] = []  # pairs of all evaluations, as long as particles have hardly moved

    def check_upcoming(self, values: list[str]) -> None:
        """Note what LAMMPS will not do as the next command requests; define a fix of our own before the deck's."""
        if values[0] == "fix" and self.lmp.extract_setting("box_exist") and not self.lmp.has_id("fix", FIRST_FIX):
            self._call(FIRST_FIX, NEVER, lambda *_: None)
        if words := hyphens(values):
            self.questions.misread(values, words)
        if values[0] == "suffix":
            styles = [word for word in values[1:] if word not in ("on", "off", "hybrid")]
            lacking = [style for style in styles if not self.lmp.has_style("pair", f"rheo/{style}")]
            if lacking:
                self.questions.suffixed(lacking)

    def _call(self, fix: str, apart: int, callback: Callable[..., None]) -> None:
        """Define a fix external, or once more in its place, which calls back and adds nothing."""
        self.lmp.command(f"fix {fix} all external pf/callback {apart} {NEVER}")
        self.lmp.set_fix_external_callback(fix, callback, None)

    def note(self, values: list[str]) -> None:
        """Note a command that LAMMPS has executed."""
        rheo = self.deck.fix("rheo")
        self.deck.note(values)
        if values[0] not in UNPREPARED:
            self._waiting = self._waiting or values[0]
        if self.deck.fix("rheo") is not rheo:
            sample.drop(self.lmp)
        for each in (self.questions, self.health, self.acting):
            each.note(values)

    def run(self, values: list[str], execute: Callable[..., None]) -> bool:
        """Execute a run command with samples; return whether the audit has done all its steps."""
        self.runs += 1
        first = self._step()
        if self.lmp.extract_setting("box_exist"):
            self.health.begin(int(self.lmp.get_natoms()))
            self.begin(values)
        sampled, begin = self.sample_seconds, time.perf_counter()
        try:
            execute()
        except Exception as error:  # LAMMPS' errors have no type of their own; all are raised again
            self.health.ended(str(error), self.runs, self._step())
            raise
        finally:
            self.lammps_seconds += time.perf_counter() - begin - (self.sample_seconds - sampled)
            self.done += self._step() - first
            arrays.take_thermo(self.lmp, self.thermo)
            if self.runs == 1 and self._last is not None:
                self.kept[self._last.step] = self._last.few()
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
            arrays.load_compiled(table)
        mass_t = None if lmp.extract_atom("rmass") else np.array(lmp.numpy.extract_atom("mass"))
        stop, count = None if steps is None else first + steps - self.done, _steps(values, first)
        oxidises = self.deck.fix("rheo/oxidation") is not None
        self._previous, self._of_pairs = None, {}
        self._shelled = arrays.marked(lmp) if oxidises else None
        if self._run is not None and ("pre", "no") in itertools.pairwise(values) and lmp.has_id("fix", FIX):
            # A new fix, or compute, would need the set-up that such a run leaves out.
            self._run = replace(
                self._run, first=first, stop=stop, continued=True, table=table, mass_t=mass_t, steps=count
            )
            if self._waiting:
                self.questions.unprepared(self.runs, self._waiting)
                reason = f"the run has no set-up (pre no), which {self._waiting} before it needs"
                known = self._run.choice
                choice = fields.Choice((), {**known.unchecked, **dict.fromkeys(known.fields, reason)})
                self._run = replace(self._run, choice=choice, sampler=None, shared="")
        else:
            self._waiting = ""
            sample.drop(lmp)
            choice, sampler, actions = fields.Choice((), {}), None, self.deck.plain_actions()
            if table is not None:
                choice, sampler = self._choose(table, mass_t, actions, values)
            shared = self._added(choice) if sampler is not None else ""
            deck = copy.deepcopy(self.deck)
            self._run = WatchedRun(first, stop, False, table, mass_t, actions, choice, sampler, deck, shared, count)
            if lmp.has_id("fix", FIX):
                lmp.command(f"unfix {FIX}")
            # Called on the steps to sample, on the first step, and on the last step of the audit; on all with shells.
            apart = 1 if oxidises else math.gcd(self.options.every, first, stop or 0)
            if lmp.has_id("fix", FIRST_FIX):
                self._call(FIRST_FIX, apart, self._called_first)
            self._call(FIX, apart, self._called)
        self.send(self._facts(self._run))

    def _choose(
        self, table: EOSTable, mass_t: Array | None, actions: list[Action], values: list[str]
    ) -> tuple[fields.Choice, sample.Sampler | None]:
        if self.options.fields == fields.PRESSURE:
            return fields.Choice(fields.PRESSURE, {}), None
        model = self._model(table, mass_t)
        _, _, xy, yz, xz, periodic, _ = self.lmp.extract_box()
        open_tilt = leans_open((xy, xz, yz), periodic)
        units = str(self.lmp.extract_global("units"))
        massless = mass_t is None and any(periodic) and not self.deck.keeps_masses()
        setting = fields.Setting(
            *(self.deck, units, open_tilt, between(values), massless, self._unfollowed(), self._heat()),
            shells=self.lmp.has_id("fix", FIRST_FIX),
        )
        choice = fields.choose(self.options.fields, model, setting)
        if not isinstance(model, Model) or choice.fields == fields.PRESSURE:
            return choice, None
        unlists, hybrid = self.deck.unlists_bonded, self.deck.bonds[:1] == ["hybrid"]
        followed = "f" in choice.fields and not (self.deck.acts_on_forces() or self.deck.elastic_styles())
        return choice, sample.Sampler(
            *(self.lmp, choice.fields, model, actions, mass_t, self.engine, unlists, hybrid), followed=followed
        )

    def _unfollowed(self) -> str:
        """Return what adds to the forces of pairs and bonds that are followed; or nothing."""
        first = self.lmp.has_id("fix", FIRST_FIX)
        unread = arrays.rank_count(self.lmp) > 1 and self.deck.bonds
        return (
            self.deck.adds_unfollowed(*self._types())
            or (f"bond_style {self.deck.bonds[0]} adds to it, which is read on one rank alone" if unread else "")
            or ("" if first else self.deck.acts_on_forces())
        )

    def _heat(self) -> str:
        return "" if self.lmp.has_id("fix", FIRST_FIX) else self.deck.adds_heat()

    def _types(self) -> tuple[int, int]:
        """Return the numbers of types of atoms and of bonds."""
        return int(self.lmp.extract_setting("ntypes")), int(self.lmp.extract_setting("nbondtypes"))

    def _added(self, choice: fields.Choice) -> str:
        """Return what adds to the forces, if they are left out for that alone and a share of rheo can be evaluated."""
        added = self._unfollowed() if choice.unchecked.get("f") == self._unfollowed() else ""
        own_masses = bool(self.lmp.extract_atom("rmass"))
        return added if share.can_be_had(self.deck) and not own_masses else ""

    def share(self) -> PairShare | None:
        """Return the deck of pair_style rheo alone for the last sample, where others add to its forces."""
        return None if self._shared is None else share.share(*self._shared)

    def _model(self, table: EOSTable, mass_t: Array | None) -> Model | InputError:
        of_types = self.lmp.numpy.extract_atom("mass") if mass_t is None else mass_t  # some laws of LAMMPS use these
        mass = [1.0] * len(table) if of_types is None else [m or 1.0 for m in of_types[1:].tolist()]
        try:
            manual = manual_of(str(self.lmp.version()))
            dimension, bond_types = int(self.lmp.extract_setting("dimension")), self._types()[1]
            return self.deck.model(dimension, len(table), mass, table, manual, bond_types)
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
            self.acting.killing(self.deck),
        )

    def _called_first(self, caller: object, step: int, n: int, tag_n: Array, x_nc: Array, force_nc: Array) -> None:
        """Keep forces and heat flows before the deck's fixes change them."""
        force_nc.fill(-0.0)
        assert self._run is not None
        if self._run.sampler is not None and self._sampled(self._run, step):
            self._of_pairs = self._run.sampler.of_pairs(len(arrays.ids(self.lmp)))

    def _sampled(self, run: WatchedRun, step: int) -> bool:
        return step % self.options.every == 0 or step in (run.first, run.stop)

    def _called(self, caller: object, step: int, n: int, tag_n: Array, x_nc: Array, force_nc: Array) -> None:
        begin = time.perf_counter()
        force_nc.fill(-0.0)  # the only addend that changes no bit, even of a force of -0.0
        run = self._run
        assert run is not None
        try:
            arrays.take_thermo(self.lmp, self.thermo)
            if run.table is not None and self._sampled(run, step):
                id_n = arrays.ids(self.lmp)
                with sharing(self._near):
                    self._sample(run, run.table, int(step), id_n, arrays.atoms(self.lmp, "x", len(id_n)))
            self._previous = int(step)
            if self._shelled is not None:
                self._shelled = arrays.marked(self.lmp)
        except BaseException as error:  # ctypes would print and discard it
            self._failure = error
        if self._failure is not None or step == run.stop:
            self.lmp.force_timeout()
        self.sample_seconds += time.perf_counter() - begin

    def _sample(self, run: WatchedRun, table: EOSTable, step: int, tag_n: Array, x_nc: Array) -> None:
        dt = float(self.lmp.extract_global("dt"))
        now = arrays.read_pressure(self.lmp, table, run.mass_t, step, tag_n, x_nc)
        # A run calls back twice on one step where it is set up again, in between (run ... every).
        setup = not run.continued and step in (run.first, self._previous)
        state = {name: now.arrays[name] for name in ("x", "v", "rho", "energy") if name in now.arrays}
        finite = self.health.state(self.runs, step, now.arrays["id"], state, step == run.first)
        taken = self._taken(run, table, len(tag_n), x_nc, setup) if finite and len(tag_n) else None
        timed = None
        if taken is not None:
            timed = TimedSample(taken, dt, self.runs, step, tag_n.copy(), step == run.first)
        slow = timed is not None and self._look(run, timed)
        others, unpredictable = dict[str, Comparison](), Explained()
        if run.sampler is not None and slow:
            others, unpredictable = self._compare(run.sampler, step, tag_n)
            if others and run.shared:
                units, of_rheo = str(self.lmp.extract_global("units")), run.sampler.last
                self._shared = run.deck, of_rheo, tag_n.copy(), now.box_c, units, run.shared, self.runs, step
        now = self._usable(replace(now, others=others, checked="pressure" in run.choice.fields), setup)
        rows = self._rows(now, tag_n, run.sampler if taken is not None else None)
        self._last = now
        if self.runs == 1 and step == run.first:
            self.kept[step] = now.few()
        looked_at = timed if others or run.sampler is None else None
        broke = self.health.broke is not None
        found = self.fluid.take(looked_at, run.sampler, step == run.first, broke, unpredictable)
        budgets = self._budget(run, step, 0.0 if setup else 0.5 * dt, bool(found))
        open_ = {field: tuple(entry.id for entry in entries) for field, entries in unpredictable.items()}
        self.send(SampleRows(step, self.runs, self.done + step - run.first, rows, found, budgets, open_))
        verdicts = {row.verdict for row in rows.values()}
        if self._differing is None and "differs" in verdicts:
            self._differing = now
        if self._explained is None and "explained" in verdicts:
            self._explained = now

    def _taken(self, run: WatchedRun, table: EOSTable, n: int, x_nc: Array, setup: bool) -> ParticleSample | None:
        """Return the particles of a sample; None without a model."""
        if run.sampler is not None:
            return run.sampler.take(n, x_nc, setup, "f" not in self._of_pairs, self._shelled)
        model = self._model(table, run.mass_t)
        if not isinstance(model, Model):
            return None
        return sample.taken(self.lmp, model, run.actions, run.mass_t, n, x_nc)

    def _look(self, run: WatchedRun, now: TimedSample) -> bool:
        """Judge a sample for questionable set-ups; return whether its particles stay near their neighbours."""
        model, state = now.sample.model, now.sample.state
        self.health.fluid(self.runs, now.step, now.id_n, model, state, bool(run.deck.adds_heat()), now.first)
        if now.first and fields.ALL in self.options.fields:
            self.acting.begin(self.lmp, self.deck, now.sample, run.steps, not run.continued)
        if mach(model, state) <= RUNAWAY:
            self.questions.look(now)
            self.questions.stillness.look(now.step, now.id_n, now.sample, now.first)
            return True
        if run.sampler is not None:  # neighbour lists are not made for particles that move so far
            self.questions.run_away(self.runs, now.step)
        return False

    def _compare(self, sampler: sample.Sampler, step: int, tag_n: Array) -> tuple[dict[str, Comparison], Explained]:
        shown = sampler.shown(len(tag_n), self._of_pairs)
        found = sampler.compare(tag_n, shown)
        reference = {name: np.asarray(value(found.reference.output(name)), float) for name in shown}
        self.health.fields(self.runs, step, tag_n, shown, reference)
        self.questions.tilted = max(self.questions.tilted, sampler.tilted)
        return found.comparisons, found.unpredictable

    def _usable(self, now: PressureSample, setup: bool) -> PressureSample:
        """Return a sample without particles whose law has no pressure, or whose densities are not those used."""
        rows_n = np.isfinite(now.arrays["rho"]) & np.isfinite(now.arrays.get("energy", 0.0))
        if setup and self.deck.sums_walls():  # LAMMPS then shows other densities of walls than it used (see the ledger)
            rows_n &= now.arrays["status"] & SOLID == 0
        return now if rows_n.all() else now.of(rows_n)

    def _rows(
        self, now: PressureSample, tag_n: Array, sampler: sample.Sampler | None
    ) -> dict[tuple[str, int], SampleRow]:
        """Return the rows of a sample's fields, in the order of a force evaluation; its pressures are compared here."""
        rows = {(field, 0): SampleRow.of(len(c.bound_n), c.record) for field, c in now.others.items()}
        for t, (of_type, comparison) in now.compare().items():
            rho_n, p_n, status_n = (now.arrays[name][of_type] for name in ("rho", "p", "status"))
            self.questions.take(t, now.table[t], status_n, rho_n, p_n)
            if now.checked:
                if comparison.record.verdict == "differs" and sampler is not None:
                    pressure_n = self.lmp.numpy.extract_atom("pressure")[: len(tag_n)]
                    sampler.explain_pressure(tag_n, pressure_n, comparison.record)
                rows["pressure", t] = SampleRow.of(rho_n.size, comparison.record)
        order = fields.offered()
        return dict(sorted(rows.items(), key=lambda item: (order.index(item[0][0]), item[0][1])))

    def _budget(self, run: WatchedRun, step: int, half_step: float, with_findings: bool) -> tuple[BudgetRecord, ...]:
        """Return the conserved quantities of a sample if they are wanted, and the forces of all pairs are known."""
        now = run.sampler.last if run.sampler else None
        if not self.options.budgets or run.sampler is None or now is None or not run.sampler.followed:
            return ()
        if mach(now.model, now.state) > RUNAWAY:
            return ()
        force_nc = arrays.atoms(self.lmp, "f", len(now.mass_n))[:, : now.model.dimension]
        entries = touching(now, self.engine) if with_findings else ()
        of_press = [] if half_step else of_pressure(now, self.engine)
        return (budget(now, force_nc, self.runs, step, half_step, entries, of_press),)

    def final(self) -> tuple[dict[str, Array], dict[int, FieldRecord]]:
        """Return arrays by id, and the pressure's fields per type in the last sample with the digits lost.

        The arrays are those of the first sample in which a field differs, which shows more than what a run that has
        blown up ends with. If none does, those of the last sample, or, if atoms are missing there, of the first one in
        which a known bug shows.
        """
        if self._last is None:
            return {}, {}
        of_last, records = self._last.result()
        shown = self._differing
        if shown is None and self._explained and len(self._explained.arrays["id"]) > len(self._last.arrays["id"]):
            shown = self._explained
        return (of_last if shown is None else shown.result()[0]), records


def _steps(values: list[str], first: int) -> int:
    """Return how many steps a run command takes; 0 if its argument is not a number."""
    count = int(float(values[1])) if len(values) > 1 and values[1].replace(".", "", 1).isdigit() else 0
    return max(count - first, 0) if "upto" in values else count
