"""A user's own input deck, unchanged, checked live while LAMMPS runs it.

`supervise.audit_deck` copies the deck's folder, lets LAMMPS run the deck there in a process of its own, and compares
whatever follows from LAMMPS' own positions, velocities, densities and energies with the reference.

Modules: `text` (syntax of input scripts), `guard` (commands that are refused), `follow` (the flow of a deck), `deck`
(the model that its commands define), `fields` (those that can be checked), `watch` (the hook into runs), `pressure` and
`sample` (comparisons), `evaluation` (the reference's side), `explanation` (by the ledger), `effects` (what known
findings do to the deck), `outlook` (why a run broke off), `budget`, `rerun`, `closed` and `balance` (what is conserved,
and what makes up the difference to a closed solution), `warn` (questionable set-ups), `child`, `launch`, `messages`
and `supervise` (the process, and what it may do), `scratch` (the copy), `verdict` (the record), `command` (what writes
the report). Finished output: `setups` (a deck followed without its runs), `printed` (what columns hold, and how many
digits), `frames` (a snapshot as a sample), `finished` (dumps), `restart`. In another unit of length: `scaling` (the
commands), `rescale` (the deck).

Called, the package is `lammps_cases.audit.command.audit`.
"""

import sys

from lammps_cases.records.options import CallableModule

sys.modules[__name__].__class__ = CallableModule
