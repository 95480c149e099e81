"""A LAMMPS taken in: everything that is asked of an engine before it is known, and what the repository keeps of it."""
