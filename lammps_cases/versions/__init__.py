"""Compare LAMMPS' numbers between two versions, builds or runs.

`outcomes` reads the cases of a run or an accepted baseline, `changes` compares two of them, `change` condenses
hundreds of changed fields into a few lines. `sources` turns names of engines and folders into sides, `baseline` keeps
accepted results, `bisection` finds the first of several engines that changed, `adopt` adds a new one.
"""
