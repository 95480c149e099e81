"""The main job: a campaign over cases, its folder, shards, tables; the function is `lammps_cases.run.command.run`."""
