"""Layers and stages out of arrays."""
