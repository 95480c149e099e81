"""Studies in addition to the main job: speed against accuracy, flows with known solutions, maps of stability."""
