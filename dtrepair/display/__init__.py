"""Pictures of meshes, and the window that shows them."""
