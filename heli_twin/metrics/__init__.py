"""Metrics: functions of a recorded flight, the same live and from a file."""
