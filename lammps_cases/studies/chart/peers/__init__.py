"""Other codes, run as programs of their own when they are installed: only their times come back."""
