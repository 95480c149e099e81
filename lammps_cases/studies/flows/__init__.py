"""Flows with a known solution, experiment or table, on the reference and on LAMMPS; see `flow`."""
