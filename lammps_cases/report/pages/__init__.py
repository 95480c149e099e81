"""What all HTML pages share: frame, parts, figures."""
