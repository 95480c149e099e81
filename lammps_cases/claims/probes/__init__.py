"""Put to LAMMPS what no scene can say: commands of a harmless deck or scene, edited, each on a LAMMPS of its own."""

PREFIX = "probes."  # records of probes are named so, and those of no case
