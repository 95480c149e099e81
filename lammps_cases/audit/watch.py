"""The look at the atoms while LAMMPS runs: the pressure that forces use against the laws then in force, other fields.

A ``fix external`` behind the deck's own fixes calls back after the forces: there, the state and all that was made of it
belong to one and the same evaluation. At the end of a step they do not (density has moved on by half a step).
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref import EOSTable, parse_fix_rheo, parse_fix_rheo_pressure, resolve
from eos_ref.eos import bounds
from eos_ref.errors import InputError
from eos_ref.model.parameters import Model
from lammps_cases.audit import fields, look
from lammps_cases.audit.deck import HARMLESS, Deck
from lammps_cases.audit.options import Facts, Look, Row
from lammps_cases.audit.warn import SOLID, Questions
from lammps_cases.comparison.compare import Comparison, EosState, compare_pressure
from lammps_cases.records.run_record import FieldRecord, LawRecord
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict.particle_model import derived

Array = npt.NDArray[Any]
FIX = "eosref_audit"
NEVER = 2**31 - 1  # steps between two uses of the callback's forces
STYLES = ("rheo", "rheo/pressure")


class Watch:
    """Keeps the deck's fixes, sets up the look before every run, and counts steps.

    Parameters
    ----------
    lmp : lammps
        An open instance.
    every : int
        Steps between two looks.
    limit : int or None
        Steps to do, all runs together.
    send : callable
        Given a `Facts` at the start of every run and a `Look` at every look.
    asked : sequence of str
        Fields, or ``all``.
    engine : str
        Version of the distribution, for the ledger.
    """

    def __init__(
        self,
        lmp: Any,
        every: int,
        limit: int | None,
        send: Callable[[object], None],
        asked: Sequence[str] = fields.DEFAULT,
        engine: str = "",
    ) -> None:
        self.lmp, self.every, self.limit, self.send = lmp, every, limit, send
        self.asked, self.engine = asked, engine
        self.deck = Deck()
        self.choice = fields.Choice((), {})
        self.reader: look.Reader | None = None
        self.questions = Questions()
        self.table: EOSTable | None = None
        self.last: dict[str, Array] | None = None
        self.last_table: EOSTable | None = None
        self.last_others: dict[str, Comparison] = {}
        self.runs = self.done = 0
        self.lammps_seconds = self.look_seconds = 0.0
        self._mass_t: Array | None = None
        self._first = 0
        self._before: int | None = None  # step of the last call
        self._continued = False
        self._stop: int | None = None
        self._failure: BaseException | None = None

    def concerns(self, values: list[str]) -> bool:
        """Whether a command changes the laws."""
        match values:
            case ["fix", _, _, style, *_]:
                return style in STYLES
            case ["unfix", name]:
                return name in self.deck.fixes and self.deck.fixes[name][3] in STYLES
            case _:
                return values[0] == "clear"

    def note(self, values: list[str]) -> None:
        """Take down a command that LAMMPS has executed."""
        rheo = self.deck.fix("rheo")
        self.deck.note(values)
        if self.deck.fix("rheo") is not rheo:
            look.drop(self.lmp)
        self.questions.note(values)

    def run(self, values: list[str], execute: Callable[[], None]) -> bool:
        """Execute a run command with looks; whether the audit has done all the steps asked for."""
        self.runs += 1
        self._first = int(self.lmp.extract_global("ntimestep"))
        if self.lmp.extract_setting("box_exist"):
            self._begin(values)
        looked, begin = self.look_seconds, time.perf_counter()
        try:
            execute()
        finally:
            self.lammps_seconds += time.perf_counter() - begin - (self.look_seconds - looked)
            self.done += self._steps_since_start()
            self.table = None  # a minimization calls back too, but evaluates no pressure
        if self._failure is not None:
            raise self._failure
        return self.limit is not None and self.done >= self.limit

    def _steps_since_start(self) -> int:
        return int(self.lmp.extract_global("ntimestep")) - self._first

    def _begin(self, values: list[str]) -> None:
        self.table = self._laws()
        self._mass_t = None if self.lmp.extract_atom("rmass") else np.array(self.lmp.numpy.extract_atom("mass"))
        self._before = None
        self._continued = ("pre", "no") in itertools.pairwise(values) and self.lmp.has_id("fix", FIX)
        self._stop = None if self.limit is None else self._first + self.limit - self.done
        if self.table is None:
            self.questions.unwatched(self.runs)
        if not self._continued:  # a new fix, or compute, would need the set-up that such a run leaves out
            self._set_up(values)
        self.send(self._facts())

    def _set_up(self, values: list[str]) -> None:
        look.drop(self.lmp)
        self.reader = None
        if self.table is not None:
            self._choose(self.table, values)
        if self.lmp.has_id("fix", FIX):
            self.lmp.command(f"unfix {FIX}")
        # Called on the steps to look at, on the first one, and on the last one asked for.
        apart = math.gcd(self.every, self._first, self._stop or 0)
        self.lmp.command(f"fix {FIX} all external pf/callback {apart} {NEVER}")
        self.lmp.set_fix_external_callback(FIX, self._called, None)

    def _choose(self, table: EOSTable, values: list[str]) -> None:
        """What is checked in the run that begins."""
        if self.asked == fields.DEFAULT:
            self.choice = fields.Choice(fields.DEFAULT, {})
            return
        model = self._model(table)
        words = values[values.index("every") + 2 :] if "every" in values else []
        between = next((word for word in words if word.split()[:1] and word.split()[0] not in HARMLESS), "")
        _, _, *tilts, _, _ = self.lmp.extract_box()
        setting = fields.Setting(self.deck, str(self.lmp.extract_global("units")), any(tilts), between)
        self.choice = fields.choose(self.asked, model, setting)
        if isinstance(model, Model) and self.choice.fields != fields.DEFAULT:
            actions = self.deck.actions() if "f" in self.choice.fields else []
            self.reader = look.Reader(self.lmp, self.choice.fields, model, actions, self._mass_t, self.engine)

    def _model(self, table: EOSTable) -> Model | InputError:
        dimension, ntypes = (int(self.lmp.extract_setting(name)) for name in ("dimension", "ntypes"))
        mass_t = [1.0] * ntypes if self._mass_t is None else self._mass_t[1:].tolist()
        try:
            return self.deck.model(dimension, ntypes, mass_t, table)
        except InputError as error:
            return error

    def _fix(self, style: str) -> str | None:
        values = self.deck.fix(style)
        return None if values is None else " ".join(values)

    def _laws(self) -> EOSTable | None:
        pressure, rheo = self._fix("rheo/pressure"), self._fix("rheo")
        if pressure is None or rheo is None:
            return None
        ntypes = int(self.lmp.extract_setting("ntypes"))
        fix = parse_fix_rheo(rheo, ntypes)
        table = resolve(parse_fix_rheo_pressure(pressure), ntypes, fix.rho0, fix.cs, pressure)
        _warm(table)
        return table

    def _facts(self) -> Facts:
        laws = []
        if self.table is not None:
            mass_t = self._mass_t
            laws = [
                LawRecord.of(t, law, None if mass_t is None else float(mass_t[t]))
                for t, law in enumerate(self.table.laws, 1)
            ]
        return Facts(
            int(self.lmp.get_natoms()),
            int(self.lmp.extract_setting("dimension")),
            str(self.lmp.extract_global("units")),
            laws,
            [bounds.comparison_derivation(law) for law in self.table.laws] if self.table else [],
            self.runs,
            self.choice.unchecked if self.table else {},
            {field: FIELDS[field].stage for field in self.choice.fields},
            derived(0),
        )

    def _called(self, caller: object, step: int, n: int, tag: Array, x_nc: Array, force_nc: Array) -> None:
        begin = time.perf_counter()
        force_nc.fill(-0.0)  # the one addend that changes no bit, not even of a force of -0.0
        try:
            if self.table is not None and (step % self.every == 0 or step == self._first or step == self._stop):
                self._look(int(step), n, tag, x_nc)
            self._before = int(step)
        except BaseException as error:  # ctypes would print and forget it
            self._failure = error
        if self._failure is not None or step == self._stop:
            self.lmp.force_timeout()
        self.look_seconds += time.perf_counter() - begin

    def _look(self, step: int, n: int, tag: Array, x_nc: Array) -> None:
        assert self.table is not None
        atoms = self.lmp.numpy
        type_n = atoms.extract_atom("type")[:n]
        now: dict[str, Array] = {
            "id": tag.copy(),
            "type": type_n.copy(),
            "x": x_nc.copy(),
            "rho": atoms.extract_atom("rho")[:n].copy(),
            "p": atoms.extract_atom("pressure")[:n].copy(),
            "mass": self._mass_t[type_n] if self._mass_t is not None else atoms.extract_atom("rmass")[:n].copy(),
            "box": np.array(self.lmp.extract_box()[:2]),
            "step": np.array(step),
        }
        if self.table.needs_energy:
            now["energy"] = atoms.extract_atom("esph")[:n].copy()
        if step == self._first and n:
            self._judge(n, x_nc)
        status_n = atoms.extract_atom("rheo_status")[:n]
        # A run calls back twice on one step where it is set up anew, in between (run ... every).
        setup = not self._continued and step in (self._first, self._before)
        others = self.reader.look(tag, x_nc, setup) if self.reader is not None else {}
        if self.reader is not None:
            self.questions.tilted = max(self.questions.tilted, self.reader.tilted)
        if setup and self._sums_walls():  # then LAMMPS shows other densities of walls than it used (see the ledger)
            fluid = status_n & SOLID == 0
            now = {name: array if name in ("step", "box") else array[fluid] for name, array in now.items()}
            status_n = status_n[fluid]
        self.last, self.last_table, self.last_others = now, self.table, others
        rows = {}
        for t, (of_type, comparison) in by_type(self.table, now, digits=False).items():
            rho_n = now["rho"][of_type]
            self.questions.look(t, self.table[t], status_n[of_type], rho_n, now["p"][of_type])
            if "pressure" in self.choice.fields:
                rows["pressure", t] = _row(rho_n.size, comparison.record)
        rows |= {(field, 0): _row(len(found.bound_n), found.record) for field, found in others.items()}
        order = {field: k for k, field in enumerate(fields.offered())}
        rows = dict(sorted(rows.items(), key=lambda item: (order[item[0][0]], item[0][1])))
        self.send(Look(step, self.runs, self.done + step - self._first, rows))

    def _judge(self, n: int, x_nc: Array) -> None:
        """How far the particles lie from where the deck would fail."""
        assert self.table is not None
        model = self._model(self.table)
        if isinstance(model, Model) and np.isfinite(x_nc[:n]).all():
            state, box = look.particles(self.lmp, model, n, x_nc)
            self.questions.begin(self.runs, model, box, state, float(self.lmp.extract_global("dt")))

    def _sums_walls(self) -> bool:
        words = self.deck.fix("rheo") or []
        return "rho/sum" in words and "interface/reconstruct" in words

    def final(self) -> tuple[dict[str, Array], dict[int, FieldRecord]]:
        """Arrays of the last look by id, and the pressure's fields per type with the digits lost."""
        if self.last is None or self.last_table is None:
            return {}, {}
        order_n = np.argsort(self.last["id"], kind="stable")
        now = {name: array if name in ("step", "box") else array[order_n] for name, array in self.last.items()}
        arrays = {name: now[name] for name in ("id", "type", "x", "rho", "box", "step")}
        if "energy" in now:
            arrays["e"] = now["energy"] / now["mass"]
        for field, found in self.last_others.items():
            if len(found.bound_n) == len(order_n):
                sides = {"lammps": found.lammps_n, "reference": found.reference_n, "bound": found.bound_n}
                arrays |= {f"{field}.{side}": values_n[order_n] for side, values_n in sides.items()}
        if "pressure" not in self.choice.fields:
            return arrays, {}
        pressure = {side: np.empty(len(order_n)) for side in ("reference", "bound")}
        records = {}
        for t, (of_type, comparison) in by_type(self.last_table, now, digits=True).items():
            pressure["reference"][of_type] = comparison.reference_n
            pressure["bound"][of_type] = comparison.bound_n
            records[t] = comparison.record
        return arrays | {"pressure.lammps": now["p"]} | {f"pressure.{k}": v for k, v in pressure.items()}, records


def _row(natoms: int, record: FieldRecord) -> Row:
    return Row(
        natoms,
        record.verdict,
        record.max_abs or 0.0,
        record.max_over_bound or 0.0,
        record.bound or 0.0,
        record.worst_id or 0,
        record.outside,
        record.first_id,
        tuple(record.explained_by),
    )


def _warm(table: EOSTable) -> None:
    """Load the compiled loops before the run, not in its first look."""
    types, ones = np.arange(1, len(table) + 1, dtype=np.int32), np.ones(len(table))
    by_type(table, {"id": types, "type": types, "rho": ones, "p": ones, "mass": ones, "energy": ones}, digits=False)


def by_type(table: EOSTable, now: dict[str, Array], digits: bool) -> dict[int, tuple[Array | slice, Comparison]]:
    """Compare the pressures of one look, type by type."""
    found: dict[int, tuple[Array | slice, Comparison]] = {}
    types = np.flatnonzero(np.bincount(now["type"])).tolist()  # a tenth of the time of np.unique
    for t in types:
        of_type: Array | slice = slice(None) if len(types) == 1 else now["type"] == t
        law = EOSTable((table[t],))  # alone, as the comparison takes its time for every law of a table
        energy_n = now["energy"][of_type] if law.needs_energy else None
        rho_n = now["rho"][of_type]
        state = EosState(now["id"][of_type], np.ones(rho_n.size, np.int32), rho_n, now["mass"][of_type], energy_n)
        found[t] = of_type, compare_pressure(law, state, now["p"][of_type], digits=digits)
    return found
