"""Tuning of the control laws on the twin."""
