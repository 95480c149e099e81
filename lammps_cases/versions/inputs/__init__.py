"""Bad input: generated from the syntax of the commands, given to LAMMPS and to the reference."""
