"""What commands leave on disk: records of runs, files, wording."""
