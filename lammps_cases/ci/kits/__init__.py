"""Files that run eos-ref in a CI service, for repositories of others."""
