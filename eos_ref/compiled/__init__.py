"""The sums over neighbours compiled: neighbours, loops, corrections, forces."""
