"""Random damage of everything that is read: bounded in the test run, long by DTREPAIR_FUZZ=N."""
