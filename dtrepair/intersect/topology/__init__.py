"""What the triangles of a mesh tell by themselves, kept and asked on a device."""
