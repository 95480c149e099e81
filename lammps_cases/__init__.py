"""lammps_cases: scenes, real LAMMPS beside the reference, comparison, reports and the ``eos-ref`` command."""
