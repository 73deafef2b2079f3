"""Bodies that are led apart as a whole before anything is pushed."""
