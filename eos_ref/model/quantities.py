"""What depends on what: the quantities of a force evaluation as a graph, so that no more is computed than is asked for.

A quantity is named as LAMMPS' output of it is (``grad/v``), or in words where there is none (``kernel``). `required`
orders what some fields need; `eos_ref.evaluation.time_step` evaluates just that, in that order.
"""

from __future__ import annotations

from collections.abc import Iterable

from eos_ref.errors import InputError
from eos_ref.model.parameters import Model

# In the order of a force evaluation.
ORDER = (
    "pairs",
    "coordination",
    "kernel",
    "rho",
    "correction",
    "chi",
    "grad/v",
    "grad/rho",
    "grad/energy",
    "shift/v",
    "surface",
    "viscosity",
    "pressure",
    "temperature",
    "heatflow",
    "drho",
    "f",
    "stress/v",
    "stress/t",
)
# Outputs that are a part of a quantity, or another name of it.
PART_OF = {
    "surface/r": "surface",
    "surface/n": "surface",
    "surface/divr": "surface",
    "pressure_used": "pressure",
    "status": "surface",
}
# What every step changes or has from the start: no quantity of an evaluation.
STATE = ("x", "v", "energy", "phase", "conductivity", "cv")
FIELDS = (*ORDER, *PART_OF, *STATE)


def inputs(model: Model) -> dict[str, tuple[str, ...]]:
    """What every quantity of a model is computed from."""
    fix, pair = model.fix, model.pair
    walls, corrected = fix.interface_reconstruct, model.corrects_gradients
    gas = ("energy",) if model.eos.needs_energy else ()
    density = ("rho", "chi") if walls else ("rho",)
    gradient = ("correction" if corrected else "kernel", *density)
    power = any(law.style == "power" for law in model.viscosity)
    shift = ("kernel", *density, *(["surface"] if fix.surface_detection else []))
    surface = ("pairs", "coordination", "kernel", *density) if fix.surface_detection else ()
    # One pass over the pairs gives force, density diffusion and heat flow; all terms of the model are in it.
    pairwise = (
        *gradient,
        *(["grad/v"] if pair.artificial_viscosity else []),
        *(["grad/rho"] if pair.rho_damp and corrected else []),
        *(["temperature"] if fix.thermal else []),
    )
    return {
        "pairs": (),
        "coordination": ("pairs",),
        "kernel": ("pairs",),
        "rho": ("kernel",) if fix.rho_sum else (),
        "correction": ("kernel", "coordination", "rho"),
        "chi": ("kernel", "rho"),
        "grad/v": gradient,
        "grad/rho": gradient,
        "grad/energy": gradient,
        "shift/v": shift,
        "surface": surface,
        "viscosity": ("grad/v",) if power else (),
        "pressure": (*density, *gas),
        "temperature": ("energy",),
        "heatflow": pairwise,
        "drho": pairwise,
        "f": (*pairwise, "pressure", "viscosity"),
        "stress/v": ("grad/v", "viscosity"),
        "stress/t": ("stress/v", "pressure"),
        "energy": (),
    }


def needed_to_step(model: Model) -> tuple[str, ...]:
    """Fields that a time step itself needs."""
    fix = model.fix
    wanted = ["f"]
    if not fix.rho_sum:
        wanted += ["grad/v", "drho"]
    if fix.shift:
        wanted += [
            "shift/v",
            "grad/v",
            *([] if fix.rho_sum else ["grad/rho"]),
            *(["grad/energy"] if fix.thermal else []),
        ]
    if fix.thermal:
        wanted += ["temperature", "heatflow"]
    return tuple(wanted)


def required(model: Model, wanted: Iterable[str]) -> tuple[str, ...]:
    """All quantities that some fields need, in the order of evaluation.

    Raises
    ------
    InputError
        A field that there is not, or that this model has not.
    """
    graph = inputs(model)
    absent = {
        "shift/v": not model.fix.shift,
        "surface": not model.fix.surface_detection,
        "chi": not model.fix.interface_reconstruct,
        "temperature": model.thermal is None,
        "heatflow": model.thermal is None,
        "energy": model.thermal is None,
        "conductivity": model.thermal is None,
        "cv": model.thermal is None,
    }
    found: set[str] = set()
    ahead = []
    for field in wanted:
        if field not in FIELDS:
            raise InputError("field", f"must be one of {', '.join(FIELDS)}", field)
        name = PART_OF.get(field, field)
        if field == "status" and not model.fix.surface_detection:
            continue
        if absent.get(name):
            raise InputError("field", "is not part of this model (see the keywords of fix rheo)", field)
        ahead.append(name)
        if field == "rho" and model.fix.interface_reconstruct:
            ahead.append("chi")  # the density read is the one that the walls have got
    while ahead:
        name = ahead.pop()
        if name not in found:
            found.add(name)
            ahead += graph.get(name, ())
    return tuple(name for name in ORDER if name in found)
