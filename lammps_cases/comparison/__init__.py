"""LAMMPS' fields against the reference's predictions and their bounds."""
