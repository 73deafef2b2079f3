"""The process that repairs: run by a Python that has dtrepair, never by Blender's own."""
