"""A red case made small: the smallest scene found that still fails the same way."""
