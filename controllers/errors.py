"""What the ground station raises when it is asked for something that cannot be flown."""


class InfeasibleTrajectory(ValueError):
    """A planned flight that the believed helicopter cannot follow; the message says when, what and by how much."""
