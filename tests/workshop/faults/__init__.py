"""Sensitivity of the harness: planted faults, the smallest detectable change, false alarms."""
