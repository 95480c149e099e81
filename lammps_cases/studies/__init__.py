"""Studies: speed against accuracy, flows with known solutions, maps of stability."""
