"""Input of both sides of a case: the plan, LAMMPS commands, the reference side, twins."""
