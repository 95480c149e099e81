"""The main job: a campaign over cases, its folder, shards, tables."""
