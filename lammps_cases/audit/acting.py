"""Known bugs that act on a deck by its definitions, before its first step and whether or not a field shows them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from eos_ref.errors import InputError
from eos_ref.model.quantities import needed_to_step
from eos_ref.model.units import UNITS
from lammps_cases.audit.deck import Deck
from lammps_cases.audit.evaluation import ParticleSample
from lammps_cases.audit.outlook import model_with_forces
from lammps_cases.findings import LEDGER, Finding, accepting
from lammps_cases.findings.entry import DeckRun
from lammps_cases.findings.outcomes import GAS_WITHOUT_WORK
from lammps_cases.records.case_parts import ActingRecord

PRINTED = "thermo_style press"  # of a deck that names it


@dataclass
class Acting:
    """Takes the commands of a deck and the beginnings of its runs; ``found`` holds the bugs by id."""

    engine: str
    found: dict[str, ActingRecord] = field(default_factory=dict)
    _shown: set[str] = field(default_factory=lambda: {"press"})  # by thermo_style one, the default
    _kept: list[str] | None = None  # the fix rheo of the run before, or of the file that was read
    _created: bool = False  # whether particles were created after a run

    def note(self, values: list[str]) -> None:
        """Take a command that LAMMPS has executed."""
        match values:
            case ["compute", _, _, style, *words]:
                self._shown |= {f"compute {style}", *(words if style == "rheo/property/atom" else ())}
            case ["thermo_style", style, *columns]:
                self._shown.discard("press")
                self._shown |= {"press"} if style in ("one", "multi") else {*columns}
                self._shown |= {PRINTED} if "press" in self._shown else set()
            case ["read_restart", *_]:
                self._kept = values
            case ["create_atoms", *_]:
                self._created = self._kept is not None
            case ["clear"]:
                self._kept, self._created = None, False

    def accepted(self, error: InputError) -> InputError:
        """Take an argument that LAMMPS has accepted and the reference refuses; return its error with the known bug."""
        entry = accepting(error, self.engine)
        if entry is None:
            return error
        self._take(entry, entry.effect)
        rule = f"{error.rule} (LAMMPS accepts it: known bug {entry.id})"
        return InputError(error.what, rule, error.found, error.where, error.key)

    def begin(self, lmp: Any, deck: Deck, sample: ParticleSample, steps: int, set_up: bool) -> None:
        """Take the particles at the beginning of a run of some steps; ``set_up``: whether its forces are computed."""
        units: Any = str(lmp.extract_global("units"))
        model = model_with_forces(sample) or sample.model
        model = replace(model, units=units) if units in UNITS else model
        fields = needed_to_step(model)
        problem = replace(sample.problem(fields, (0, steps) if steps else (0,)), model=model)
        rheo = deck.fix("rheo")
        setting = DeckRun(
            problem,
            again=set_up and self._kept is not None and (self._kept is rheo or self._kept[0] == "read_restart"),
            reacts="react" in (deck.fix("rheo/thermal") or ()),
            created=self._created,
            deforms=deck.fix("deform") is not None and not deck.moves_images(),
            shown=frozenset(self._shown),
        )
        self._kept = rheo
        for entry in LEDGER:
            if entry.id not in self.found and entry.listed(self.engine) and (does := entry.acting(setting)):
                self._take(entry, does)

    def gas(self) -> None:
        """Take a gas without a model of its particles."""
        if GAS_WITHOUT_WORK.listed(self.engine):
            self._take(GAS_WITHOUT_WORK, GAS_WITHOUT_WORK.effect)

    def _take(self, entry: Finding, does: str) -> None:
        self.found[entry.id] = record_of(entry, does)


def record_of(entry: Finding, does: str) -> ActingRecord:
    """Return the record of a finding that acts on a deck."""
    return ActingRecord(finding=entry.id, does=does, own=does != entry.effect, severity=entry.severity)
