"""The manual's command text: type ranges and fix lines."""
