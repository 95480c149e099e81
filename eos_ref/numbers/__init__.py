"""Number types that formulas run on: elementary functions, rounding errors carried along, small matrices."""
