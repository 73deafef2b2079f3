"""Which contacts of an input were modelled: poses that show it, and what is told of them."""
