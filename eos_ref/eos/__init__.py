"""Equations of state: the laws, their rounding bounds, rigorous values, compiled loops."""
