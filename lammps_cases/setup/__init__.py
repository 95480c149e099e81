"""What either side of a case is given: the plan, LAMMPS commands, the reference side, twins."""
