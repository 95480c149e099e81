"""The common parts of all HTML pages: frame, parts, figures."""
