"""LAMMPS: the session that imports it, worker processes, MPI ranks, installations."""
