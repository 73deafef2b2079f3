"""A run of the repair."""
