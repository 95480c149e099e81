"""The particle model: its parameters, kernels, pair terms, particle properties, and what depends on what."""
