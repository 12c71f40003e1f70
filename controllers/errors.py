"""Errors of the ground station."""


class InfeasibleTrajectory(ValueError):
    """The believed helicopter cannot follow the trajectory; the message names the time, quantity, value and limit."""
