"""The mesh as the repair sees it, and what it asks about a pose."""
