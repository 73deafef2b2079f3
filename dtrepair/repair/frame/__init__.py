"""Work on the frames of a window: one at a time, as a pool does it, and what bounds them all."""
