"""The manual's claims: what the two pages say, what tests it, and whether it holds."""
