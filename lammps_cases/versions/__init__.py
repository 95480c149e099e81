"""Compare LAMMPS' numbers between two versions, builds or runs.

`outcomes` reads what a run or an accepted baseline holds of every case, `changes` compares two of them, `change` puts
hundreds of changed fields into a few lines. `sources` turns names of engines and folders into sides, `baseline` keeps
what was accepted, `bisection` finds the first engine of several that changed, `adopt` takes in a new one.
"""
