"""Flows that others have measured, computed or solved, on the reference and on LAMMPS: informative, never a verdict."""

from lammps_cases.studies.validation import cavity, channel, convection, dam, surfaces, waves
from lammps_cases.studies.validation.model import Validation

VALIDATIONS: dict[str, Validation] = {
    v.name: v for module in (channel, cavity, dam, waves, surfaces, convection) for v in module.VALIDATIONS
}
