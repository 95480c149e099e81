"""Tests in LAMMPS beyond scenes: edited commands of a harmless deck or scene, each in its own LAMMPS."""

PREFIX = "probes."  # prefix of the records of probes, and of no case's
