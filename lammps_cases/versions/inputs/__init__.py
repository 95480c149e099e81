"""Bad input, generated from the syntax of the commands, and the reactions of LAMMPS and the reference."""
