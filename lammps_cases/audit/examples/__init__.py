"""LAMMPS' own example decks of RHEO, judged and taken apart: `eos-ref examples`.

Modules: `decks` (where they lie, and the logs beside them), `collect` (an audit of each, with budgets), `draw` and
`page` (the report).
"""
