"""What the artist sees: panel, operators, overlay and preferences."""
