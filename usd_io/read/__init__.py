"""Animated meshes out of a stage."""
