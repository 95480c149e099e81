"""Random scenes: drawn over the whole schema of case files, judged as cases are, made small where they are red."""
