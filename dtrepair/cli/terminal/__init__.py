"""What a terminal sees, and what ends a command early."""
