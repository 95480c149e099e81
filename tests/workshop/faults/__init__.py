"""How much the harness can see: planted faults, the smallest change that shows, false alarms."""
