"""Ways to compute the same quantity: each a small function with a name and a reason to use it."""
