"""Errors of the ground station."""


class InfeasibleTrajectory(ValueError):
    """The believed helicopter cannot follow the trajectory; the message names the time, quantity, value and limit."""


class MissingDerivatives(ValueError):
    """A trajectory gives fewer derivatives than are asked for; the message names both and what to add."""


class LawFailed(Exception):
    """The process of a control law died, hung or sent nonsense: what was flown says nothing about the law.

    Attributes:
        time: Control time, ns.
    """

    def __init__(self, time: int, reason: str) -> None:
        super().__init__(reason)
        self.time = time
