"""The changes of the reference that are tried on a red case, in words.

First those with a name: parameters of other types, keywords left out, values of the evaluation before, parts of a time
step, mistakes that the lint knows. Then all edits of the functions that the case goes through, the last one first.
No finding is among them: those that reproduce a case have explained it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

from lammps_cases.verdict import model_mistakes
from lammps_cases.verdict.diagnosis.changes import Change, VelocitiesTransposed, stale, stale_input, with_model
from lammps_cases.verdict.diagnosis.parameter_changes import KEYWORDS, type_changes
from lammps_cases.verdict.diagnosis.reached import reached
from lammps_cases.verdict.diagnosis.step_changes import step_changes

_STALE = {
    "the pressure": "pressure",
    "the viscosity": "viscosity",
    "the speed of sound": "sound_speed",
    "the temperature": "temperature",
    "the summed density": "density_sum",
    "the density that particles meet each other with": "apparent_density",
    "the same-phase fraction": "same_fraction",
    "the density of walls": "wall_density",
    "the shifting velocity": "raw_shift",
    "the viscosity of strain": "viscosity",
}
_INPUTS_KEPT = {
    "the pressures": "pressure_n",
    "the viscosities": "viscosity_n",
    "the speeds of sound": "sound_n",
    "the temperatures": "temperature_n",
    "the densities": "rho_n",
    "the velocities": "v_nc",
    "the same-phase fractions": "chi_n",
}


def candidates(types: int, run: Callable[[], Any]) -> Iterator[Change]:
    """Yield what is tried in a scene of some number of types, which ``run`` evaluates once."""
    yield from named_changes(types)
    for function in reached(run):
        for edit in function.edits():
            yield Change(function.sentence(edit), edit.before, edit=edit)


@cache
def named_changes(types: int) -> tuple[Change, ...]:
    """Return the changes with a name, in a scene of some number of types."""
    stale_values = [
        Change(f"{what} of every particle were that of the evaluation before", f"{what}, stale", stale(method))
        for what, method in _STALE.items()
    ]
    stale_inputs = [
        Change(f"the terms of pairs used {what} of the evaluation before", f"{what} of pairs, stale", stale_input(name))
        for what, name in _INPUTS_KEPT.items()
    ]
    transposed = "the gradient of velocities had its axes exchanged"
    return (
        *type_changes(types),
        *(Change(words, words, with_model(change)) for words, change in KEYWORDS.items()),
        *stale_values,
        *stale_inputs,
        Change(transposed, transposed, VelocitiesTransposed),
        *step_changes(),
        *(
            Change(f"the reference made the mistake: {name}", name, mutant.stages)
            for name, mutant in model_mistakes.MUTANTS.items()
        ),
    )
