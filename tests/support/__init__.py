"""Shared by tests: independent implementations, scenes, handmade records."""
