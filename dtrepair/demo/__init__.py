"""The character of the demo, made in code."""
