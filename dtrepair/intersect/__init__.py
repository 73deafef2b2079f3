"""Which triangles of a mesh intersect: exact, on the CPU and on CUDA from one source."""

# Contacts that can be asked for: within a body, between two, or both.
MODES = ("self", "inter", "both")
