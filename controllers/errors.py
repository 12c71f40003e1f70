"""Errors of the ground station."""


class InfeasibleTrajectory(ValueError):
    """The believed helicopter cannot follow the trajectory; the message names the time, quantity, value and limit."""


class MissingDerivatives(ValueError):
    """A trajectory gives fewer derivatives than are asked for; the message names both and what to add."""
