"""Judgement of cases: fields, first cause, findings that explain, formulas that a scene cannot tell apart."""
