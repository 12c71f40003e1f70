"""The error of a study that cannot be flown or reported."""

from heli_twin.errors import HeliTwinError


class StudyError(HeliTwinError):
    """A study that cannot be flown, or results that are not there; the message is one sentence that says what to do."""
