"""What was modelled to hold together: overlaps of parts, ends in others."""
