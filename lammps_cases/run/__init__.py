"""The main job: a campaign over cases, its folder, shards, tables; the function is `lammps_cases.run.command.run`."""

import sys

from lammps_cases.records.options import CallableModule

sys.modules[__name__].__class__ = CallableModule
