"""What was modelled to hold together: overlaps of parts, ends in others, seams of one skin."""
