"""What the meshes of a shot are to each other: a set around, furniture, props."""
