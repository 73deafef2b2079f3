"""Stage and mesh files as bodies, rests, frames and sinks."""
