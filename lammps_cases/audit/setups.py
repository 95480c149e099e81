"""A deck followed without its runs: what each begins with, and what the deck's dumps write."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from lammps_cases.audit import gather, text
from lammps_cases.audit.deck import Deck, between
from lammps_cases.audit.options import DeckDump, DeckSetups, RunSetup, ScriptCommand, StartState
from lammps_cases.audit.sample import SOLID
from lammps_cases.audit.watch import DeckWatch

ENDLESS = 2**31 - 1
# What a restart file does not bring along; it has the box, the particles, their masses and their groups.
DEFINITIONS = frozenset(
    {
        *("newton", "lattice", "region", "variable", "neighbor", "neigh_modify", "comm_modify", "comm_style"),
        *("pair_style", "pair_coeff", "pair_modify", "bond_style", "bond_coeff", "special_bonds", "timestep"),
        *("fix", "fix_modify", "unfix", "compute", "compute_modify", "uncompute"),
    }
)


class SetupWatch(DeckWatch):
    """Executes ``run 0`` in place of every run, and keeps what the run would begin with."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.described: list[RunSetup] = []
        self.computes: dict[str, list[str]] = {}
        self.dumps: list[DeckDump] = []
        self.commands: list[list[str]] = []
        self.ahead = 0  # steps of runs since LAMMPS' own count was set
        self.script: list[ScriptCommand] = []
        self.start: StartState | None = None

    def setups(self) -> DeckSetups:
        """Return all that was kept."""
        commands = [" ".join(map(text.quoted, words)) for words in self.commands]
        return DeckSetups(self.described, self.dumps, commands, self.script, self.start)

    def meet(self, where: str, written: str) -> None:
        """Take down a command that comes next, before LAMMPS substitutes it."""
        self.script.append(ScriptCommand(where, written, self.runs))

    def _keep(self, values: list[str]) -> None:
        if self.script:
            self.script[-1].values = values

    def note(self, values: list[str]) -> None:
        """Take down a command that LAMMPS has executed."""
        super().note(values)
        self._keep(values)
        if values[0] in DEFINITIONS:
            self.commands.append(values)
        match values:
            case ["compute", name, *_]:
                self.computes[name] = values
            case ["uncompute", name]:
                self.computes.pop(name, None)
            case ["dump", *words]:
                self.dumps.append(DeckDump(words, [], self.runs, ENDLESS))
            case ["undump", name]:
                self._dump(name).end = self.runs
            case ["dump_modify", name, *words]:
                self._dump(name).modify += words
            case ["write_dump", group, style, file, *words]:
                at = words.index("modify") if "modify" in words else len(words)
                written = ["", group, style, "0", file, *words[:at]]
                self.dumps.append(DeckDump(written, words[at + 1 :], self.runs, self.runs, self._step()))
            case ["reset_timestep", *_]:
                self.ahead = 0
            case ["clear"]:
                self.ahead, self.computes = 0, {}
                for dump in self.dumps:
                    dump.end = min(dump.end, self.runs)

    def _dump(self, name: str) -> DeckDump:
        return next(dump for dump in reversed(self.dumps) if dump.words[0] == name)

    def _step(self) -> int:
        return super()._step() + self.ahead

    def run(self, values: list[str], execute: Callable[..., None]) -> bool:
        """Describe a run, and count its steps; LAMMPS sets it up."""
        self._keep(values)
        if not self.runs and self.lmp.extract_atom("rheo_status"):
            self.start = self._start()
        self.runs += 1
        execute("run 0")
        first, count = self._step(), int(float(values[1]))
        last = count if "upto" in values else first + count
        self.described.append(self._setup(values, first, last))
        self.ahead += last - first
        return False

    def _start(self) -> StartState:
        lmp, n = self.lmp, len(gather.ids(self.lmp))
        low, high, xy, yz, xz, periodic, _ = lmp.extract_box()
        groups = [group for group in lmp.available_ids("group") if group]  # deleted ones have no name
        energy_n = gather.atoms(lmp, "esph", n) if lmp.extract_atom("esph") else np.zeros(0)
        return StartState(
            box_c=np.array([low, high]),
            tilt_c=np.array([xy, xz, yz]),
            periodic=[bool(flag) for flag in periodic],
            energy_n=energy_n.copy(),
            members={group: gather.members(lmp, group, n) for group in groups},
            **{
                axes: gather.atoms(lmp, name, n).copy()
                for axes, name in {
                    **{"id_n": "id", "type_n": "type", "status_n": "rheo_status"},
                    **{"x_nc": "x", "v_nc": "v", "rho_n": "rho"},
                }.items()
            },
        )

    def _setup(self, values: list[str], first: int, last: int) -> RunSetup:
        lmp = self.lmp
        id_n = gather.ids(lmp)
        n = len(id_n)
        deck = copy.deepcopy(self.deck)
        groups = sorted({action.group for action in self.deck.plain_actions()})
        status = lmp.extract_atom("rheo_status")
        return RunSetup(
            first=first,
            last=last,
            said=len(self.commands),
            dt=float(lmp.extract_global("dt")),
            version=str(lmp.version()),
            units=str(lmp.extract_global("units")),
            dimension=int(lmp.extract_setting("dimension")),
            ntypes=int(lmp.extract_setting("ntypes")),
            between=between(values),
            mass_t=None if lmp.extract_atom("rmass") else lmp.numpy.extract_atom("mass").tolist(),
            computes=dict(self.computes),
            id_n=id_n.copy(),
            solid_n=(gather.atoms(lmp, "rheo_status", n) & SOLID != 0) if status else np.zeros(n, bool),
            members={group: gather.members(lmp, group, n) for group in groups},
            newton=(bool(lmp.extract_setting("newton_pair")), bool(lmp.extract_setting("newton_bond"))),
            ranks=gather.ranks(lmp),
            **{field.name: getattr(deck, field.name) for field in dataclasses.fields(Deck)},
        )
