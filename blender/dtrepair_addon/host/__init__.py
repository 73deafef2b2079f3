"""What Blender does around the worker, without bpy: files, processes, frames and offsets."""
