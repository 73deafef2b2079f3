"""Workers for the frames of a window, and processes for single poses."""
