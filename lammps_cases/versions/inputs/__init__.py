"""Bad input: generated from the syntax of the commands, put to LAMMPS and to the reference."""
