"""A run of the deformation transfer."""
