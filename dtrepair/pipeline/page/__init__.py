"""What a report is worth looking at: its page, and pictures, out of the poses of a run."""
