"""Bodies, the scene they make, and what is told of its results."""
