"""Flows of which others know a solution, an experiment or a table, on the reference and on LAMMPS; see `flow`."""
