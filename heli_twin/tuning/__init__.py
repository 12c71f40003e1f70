"""Tuning of the control laws on the nominal twin."""
