"""What a repair did to a shape, its bounds, and the largest share of a correction within them."""
