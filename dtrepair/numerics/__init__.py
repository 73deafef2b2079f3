"""Arrays, operators and measures that everything rests on."""
