"""Bug reports that need no installation: a deck that decides between PASS and FAIL by itself, and its text."""
