"""Repeat a recorded flight, its control problems or its state estimation, from the log alone."""
