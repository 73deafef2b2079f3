"""Clips: frames solved together in windows."""
