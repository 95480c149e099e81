"""What tests share: independent implementations, scenes, records made by hand."""
