"""Triage of a red run: groups of cases with one first cause, what their scenes share, and hypotheses.

`triage` groups, `features` finds what red scenes have in common and green ones lack, `edits` (with `law_changes`,
`parameter_changes` and `step_changes`) lists the changes of the reference's formulas that are tried and `trials` says
which of them reproduce LAMMPS. A hypothesis is never an explanation: no verdict follows from it.
"""
