"""Where methods fail: maps of failures of LAMMPS and of the reference, how each fails, and whether both agree."""
