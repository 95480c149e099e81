"""Services for continuous integration: the pytest plugin and kits."""
