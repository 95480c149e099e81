"""lammps_cases: scenes, real LAMMPS and the reference, comparison, reports and the ``eos-ref`` command.

What users call is in `eos_ref`.
"""
