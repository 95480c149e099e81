"""What 1e6 cases and 1e9 particles would cost: computed from what was measured of small campaigns, and simulated."""
