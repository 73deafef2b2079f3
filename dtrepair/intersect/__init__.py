"""Which triangles of a mesh intersect: exact, on the CPU and on CUDA from one source."""
