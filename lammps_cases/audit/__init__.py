"""A user's own input deck, unchanged, checked live while LAMMPS runs it.

`supervise.audit_deck` copies the deck's folder, lets LAMMPS run the deck there in a process of its own, and compares
whatever follows from LAMMPS' own positions, velocities, densities and energies with the reference.

Modules: `text` (syntax of input scripts), `place` (where a deck runs, and what it may not do there), `deck` (the model
that its commands define), `fields` (those that can be checked), `follow` (the flow of a deck, or its set-ups alone),
`watch` (the hook into runs), `arrays` and `sample` (what LAMMPS shows, compared), `evaluation` (the reference's side),
`effects` (findings: those that explain fields, and what each does), `outlook` (whether and why a run broke off),
`rerun` and `budgets` (what is conserved, and what makes up the difference to a closed solution), `lints` and `warn`
(questionable set-ups), `share` (a second deck for the forces of pair_style rheo alone), `child`, `messages` and
`supervise` (the process), `verdict` (the record), `command` (what writes the report). Finished output: `dumps` (columns
and snapshots), `finished` (their audit). In another unit of length: `scaling` (the commands), `rescale` (the deck).
`examples`: the decks that LAMMPS ships. `flow_scales`: the scales of a deck's flow; `advised`: the deck with other
numbers.
"""
