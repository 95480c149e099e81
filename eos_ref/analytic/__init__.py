"""Analytic solutions of flows."""
