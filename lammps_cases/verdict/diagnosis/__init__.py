"""Triage of a red run: groups of cases with one first cause, common features of their scenes, and hypotheses.

`triage` groups and finds features common to red scenes and absent in green ones; `changes`, `edits` and `laws` list
the changes of the reference's formulas that are tried, and `trials` finds those that reproduce LAMMPS. A hypothesis
is never an explanation: no verdict follows from it.
"""
