"""Registration of a source to a target, and which triangles correspond."""
