"""What a scene can exercise: the rules and branches of the reference, one record each, counted on its arrays.

A case says by `exercises` which of them it is for; `lammps_cases.verdict.problems` counts them, and a case whose scene
does not take a rule that it names is an error.
"""

from __future__ import annotations

from lammps_cases.scene.rules import edges, fields, laws, motion, neighbours, pairs, surfaces, thermal, walls
from lammps_cases.scene.rules.rule import Evaluated, Rule

__all__ = ["RULES", "SUBJECTS", "Evaluated", "Rule"]

SUBJECTS: dict[str, tuple[Rule, ...]] = {
    "equations of state": laws.RULES,
    "neighbours, kernels, densities": neighbours.RULES,
    "pairs and viscosities": pairs.RULES,
    "walls": walls.RULES,
    "surfaces and shifting": surfaces.RULES,
    "heat": thermal.RULES,
    "forces, stresses, time steps": motion.RULES,
    "edges": edges.RULES,
    "fields": fields.RULES,
}
RULES: dict[str, Rule] = {rule.name: rule for rules in SUBJECTS.values() for rule in rules}
