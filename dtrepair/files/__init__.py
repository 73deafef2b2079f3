"""Mesh files and atomic writing."""
