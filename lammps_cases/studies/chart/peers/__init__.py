"""Other codes, run as separate programs if installed; only their times are used."""
