"""A run of the repair of key poses."""
