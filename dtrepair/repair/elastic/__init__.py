"""Elastic terms: as-rigid-as-possible, gaps, pressure, dihedral angles."""
