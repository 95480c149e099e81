"""Triage of a red run: groups of cases with one first cause, what their scenes share, and hypotheses.

`triage` groups and finds what red scenes have in common and green ones lack; `changes`, `edits` and `laws` list the
changes of the reference's formulas that are tried, and `trials` finds those that reproduce LAMMPS. A hypothesis is
never an explanation: no verdict follows from it.
"""
