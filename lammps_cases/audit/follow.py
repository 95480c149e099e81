"""The flow of a deck: which command comes next, and the hook before every run.

LAMMPS executes every command; only label, jump, include, if, next's consequence and quit are followed here, so
that runs inside them are met, fixes are known as LAMMPS got them, and no command passes unchecked. Conditions,
variables and substitution remain LAMMPS' own: an ``if`` is handed to LAMMPS with each branch replaced by a
number, and a line is substituted once, by LAMMPS (a random variable must not advance twice).

A deck can be followed without its runs: then the start of each run is kept, and what the deck's dumps write.
"""

from __future__ import annotations

import contextlib
import copy
import math
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref.errors import InputError
from eos_ref.model.parameters import Model
from lammps_cases.audit import arrays, place, sample, text
from lammps_cases.audit.deck import between
from lammps_cases.audit.messages import DeckDump, DeckSetups, RunSetup, ScriptCommand, StartState
from lammps_cases.audit.place import DeckPlace, written
from lammps_cases.audit.sample import SOLID
from lammps_cases.audit.watch import DeckWatch
from lammps_cases.engine.session import EngineRefused, translated

_OTHER_RANKS = "Specified processors != physical processors"
BRANCH = "eosref_branch"  # names of variables that decks will not use
LINE = "eosref_line"
_UNSET = re.compile(r"Substitution for illegal variable (\w+)")
_FLOW = frozenset({"jump", "include", "label", "next", "clear", "run", "partition"})
ENDLESS = 2**31 - 1
DEEPEST = 64  # scripts that include one another; as Python counts calls, the last message may otherwise not be sent
# What a restart file lacks; it has the box, the particles, their masses and their groups.
DEFINITIONS = frozenset(
    {
        *("newton", "lattice", "region", "variable", "neighbor", "neigh_modify", "comm_modify", "comm_style"),
        *("pair_style", "pair_coeff", "pair_modify", "bond_style", "bond_coeff", "special_bonds", "timestep"),
        *("fix", "fix_modify", "unfix", "compute", "compute_modify", "uncompute"),
    }
)


class Finished(Exception):
    """End of the deck: quit, or the last step of the audit."""


class _Script:
    """A file being read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines = iter(text.read_lines(path))


class Follower:
    """Executes a deck command by command.

    Parameters
    ----------
    lmp : lammps
        An open instance; the current folder is that in which the deck runs.
    watch : DeckWatch
        Notes every command, and executes the runs.
    report : callable
        Called with place and text of every command before LAMMPS gets it.
    within : DeckPlace, optional
        What has been copied; without it `place.check_command` is not applied to commands.
    """

    def __init__(
        self, lmp: Any, watch: DeckWatch, report: Callable[[str, str], None], within: DeckPlace | None = None
    ) -> None:
        self.lmp, self.watch, self.report, self.within = lmp, watch, report, within
        self.made: list[str] = []  # lines on folders that the deck needs
        self.scripts: list[_Script] = []
        self.seeking: str | None = None
        self.skip_jump = False
        self.where = ""
        self.grid: list[str] = []  # ranks along each axis, as the deck has them
        lmp.command(f'variable {LINE} string ""')

    def deck(self, path: Path) -> None:
        """Execute a deck to its end.

        Raises
        ------
        EngineRefused
            With LAMMPS' own error text and the place.
        InputError
            A command that is not allowed, or that cannot be followed.
        """
        try:
            self._file(path)
        except Finished:
            return

    def start(self, command: str) -> None:
        """Execute a command before the deck, as a switch of LAMMPS' command line does.

        Raises
        ------
        EngineRefused, InputError
        """
        self.where = "command line"
        self._line(command)

    def _file(self, path: Path) -> None:
        if len(self.scripts) == DEEPEST:
            raise InputError("deck", place.NESTED, where=self.where)
        self.scripts.append(self._script(path))
        while (line := next(self.scripts[-1].lines, None)) is not None:
            self.where = f"{self.scripts[-1].path}:{line.number}"
            self._line(line.text)
        self.scripts.pop()
        if self.seeking is not None:
            raise EngineRefused(f"ERROR: Label wasn't found in input script: {self.seeking} ({self.where})")

    def _script(self, path: Path) -> _Script:
        try:
            return _Script(path)
        except InputError as error:
            raise EngineRefused(f"ERROR: Cannot open input script {path}: {error.rule} ({self.where})") from None

    def _line(self, line: str) -> None:
        command = text.without_comment(line)
        words = text.words(command)
        if not words:
            return
        if self.seeking is not None:  # lines on the way to a label are not substituted
            if [word.value for word in words] == ["label", self.seeking]:
                self.seeking = None
            return
        self.report(self.where, command)
        if "$" in command:
            command = self._call(lambda: self.lmp.expand(command))
            words = text.words(command)
        if self.within is not None:
            place.check_command(words, self.where, self.within)
        if words:
            self._dispatch(command, words)

    def _dispatch(self, command: str, words: list[text.Word]) -> None:
        values = [word.value for word in words]
        match values:
            case ["label", _]:
                pass
            case ["quit", *_]:
                raise Finished
            case ["jump", file] | ["jump", file, _]:
                self._jump(file, values[2:])
            case ["include", file]:
                self._file(Path(file))
            case ["if", *_]:
                self._if(words)
            case ["next", *names]:
                self.execute(command)
                self.skip_jump = any(not self.lmp.has_id("variable", name) for name in names)
            case ["run", *_]:
                self._hidden(words)
                if self.watch.run(values, lambda text=command: self.execute(text)):
                    raise Finished
            case _:
                self._hidden(words)
                self.watch.check_upcoming(values)
                self._make_folders(values)
                if values[0] == "processors":
                    self.grid = values[1:4]
                self.execute(command)
                self.watch.note(values)

    def _jump(self, file: str, label: list[str]) -> None:
        if self.skip_jump:  # once, after next has used up its variable
            self.skip_jump = False
            return
        self.scripts[-1] = self._script(self.scripts[-1].path if file == "SELF" else Path(file))
        self.seeking = label[0] if label else None

    def _if(self, words: list[text.Word]) -> None:
        try:
            conditions, commands = text.branches(words)
        except ValueError:
            raise EngineRefused(f"ERROR: Illegal if command ({self.where})") from None
        numbered = [f'"variable {BRANCH} internal {k}"' for k in range(1, len(commands) + 1)]
        numbered_if = f"if {conditions[0]} then {numbered[0]}"
        for condition, branch in zip(conditions[1:], numbered[1:], strict=False):
            numbered_if += f" elif {condition} {branch}"
        if len(commands) > len(conditions):
            numbered_if += f" else {numbered[-1]}"
        self.execute(f"variable {BRANCH} internal 0")
        self.execute(numbered_if)
        taken = round(self.lmp.extract_variable(BRANCH))
        for inner in commands[taken - 1] if taken else ():
            self._line(inner)

    def _make_folders(self, values: list[str]) -> None:
        """Make the folders that a command writes into: they may exist where the deck is meant to run."""
        if self.lmp.extract_setting("world_rank"):  # the first rank makes them
            return
        for folder in {Path(os.path.normpath(file)).parent for file in written(values)}:
            with contextlib.suppress(OSError, ValueError):  # LAMMPS' own message follows
                if not (folder.is_absolute() or ".." in folder.parts or folder.exists()):
                    folder.mkdir(parents=True)
                    self.made.append(
                        f"folder {folder} does not exist: made in the copy, LAMMPS alone stops ({self.where})"
                    )

    def _hidden(self, words: list[text.Word]) -> None:
        """Refuse commands within another that change flow or laws, or that cannot be checked beforehand."""
        for inner in text.nested(words):
            held = text.words(text.without_comment(inner))
            values = [word.value for word in held]
            if values[:1] == ["if"]:
                self._hidden(held)
            elif values and (values[0] in _FLOW or place.is_open(values) or self.watch.deck.changes_laws(values)):
                rule = "may not hold a command that the audit has to follow"
                raise InputError(f"command {words[0].value}", rule, inner, self.where)

    def execute(self, command: str) -> None:
        """Give a substituted command to LAMMPS, which may neither substitute it again nor see a comment in it."""
        if "#" in command or "$" in command:
            self._call(lambda: self.lmp.set_string_variable(LINE, command))
            command = f"${{{LINE}}}"
        self._call(lambda: self.lmp.command(command))

    def _call(self, call: Callable[[], Any]) -> Any:
        try:
            with translated():
                return call()
        except EngineRefused as error:
            unset = _UNSET.search(str(error))
            hint = f" (-var {unset[1]} VALUE defines it, as for lmp)" if unset else ""
            if _OTHER_RANKS in str(error):
                hint = f" (--ranks {math.prod(int(n) for n in self.grid if n.isdecimal())} starts as many)"
            line = " ".join(str(error).split())
            at = line.find(" (src/") if " (src/" in line else len(line)  # the hint comes before the place in a source
            raise type(error)(f"{line[:at]}{hint}{line[at:]} ({self.where})") from None


class SetupWatch(DeckWatch):
    """Executes ``run 0`` in place of every run, and keeps the state with which the run would begin."""

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
        """Note a command that comes next, before LAMMPS substitutes it."""
        self.script.append(ScriptCommand(where, written, self.runs))

    def _keep(self, values: list[str]) -> None:
        if self.script:
            self.script[-1].values = values

    def note(self, values: list[str]) -> None:
        """Note a command that LAMMPS has executed."""
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
        self._act(last - first)
        self.ahead += last - first
        return False

    def _start(self) -> StartState:
        lmp, n = self.lmp, len(arrays.ids(self.lmp))
        low, high, xy, yz, xz, periodic, _ = lmp.extract_box()
        groups = [group for group in lmp.available_ids("group") if group]  # deleted ones have no name
        energy_n = arrays.atoms(lmp, "esph", n) if lmp.extract_atom("esph") else np.zeros(0)
        return StartState(
            box_c=np.array([low, high]),
            tilt_c=np.array([xy, xz, yz]),
            periodic=[bool(flag) for flag in periodic],
            energy_n=energy_n.copy(),
            members={group: arrays.members(lmp, group, n) for group in groups},
            **{
                axes: arrays.atoms(lmp, name, n).copy()
                for axes, name in {
                    **{"id_n": "id", "type_n": "type", "status_n": "rheo_status"},
                    **{"x_nc": "x", "v_nc": "v", "rho_n": "rho"},
                }.items()
            },
        )

    def _act(self, steps: int) -> None:
        table = self.deck.laws(int(self.lmp.extract_setting("ntypes")))
        mass_t = None if self.lmp.extract_atom("rmass") else np.array(self.lmp.numpy.extract_atom("mass"))
        model = None if table is None else self._model(table, mass_t)
        if isinstance(model, Model):
            n = len(arrays.ids(self.lmp))
            x_nc = arrays.atoms(self.lmp, "x", n)
            taken = sample.taken(self.lmp, model, self.deck.plain_actions(), mass_t, n, x_nc)
            self.acting.begin(self.lmp, self.deck, taken, steps, True)

    def _setup(self, values: list[str], first: int, last: int) -> RunSetup:
        lmp = self.lmp
        id_n = arrays.ids(lmp)
        n = len(id_n)
        groups = sorted({action.group for action in self.deck.plain_actions()})
        status = lmp.extract_atom("rheo_status")
        return RunSetup(
            first=first,
            last=last,
            before=len(self.commands),
            deck=copy.deepcopy(self.deck),
            dt=float(lmp.extract_global("dt")),
            version=str(lmp.version()),
            units=str(lmp.extract_global("units")),
            dimension=int(lmp.extract_setting("dimension")),
            ntypes=int(lmp.extract_setting("ntypes")),
            between=between(values),
            mass_t=None if lmp.extract_atom("rmass") else lmp.numpy.extract_atom("mass").tolist(),
            computes=dict(self.computes),
            id_n=id_n.copy(),
            solid_n=(arrays.atoms(lmp, "rheo_status", n) & SOLID != 0) if status else np.zeros(n, bool),
            members={group: arrays.members(lmp, group, n) for group in groups},
            newton=(bool(lmp.extract_setting("newton_pair")), bool(lmp.extract_setting("newton_bond"))),
            ranks=arrays.rank_count(lmp),
        )
