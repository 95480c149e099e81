"""Contributions to LAMMPS' own tree: tests for its test programs, and decks in the style of its examples."""
