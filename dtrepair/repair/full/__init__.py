"""The default method: its stages for a single pose."""
