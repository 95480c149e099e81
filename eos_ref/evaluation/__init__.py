"""Force evaluation and time step, in arrays of any number type."""
