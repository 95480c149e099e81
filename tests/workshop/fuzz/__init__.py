"""Random scenes: drawn over the whole schema of case files, judged as cases are, and shrunk if red."""
