"""The published method (Jang et al. 2025), on the host and on a device."""
