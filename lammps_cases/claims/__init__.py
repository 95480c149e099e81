"""The manual's claims: the statements of the two pages, their tests, and whether they hold."""
