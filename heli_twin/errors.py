"""The base of every error that heli_twin raises for its user."""


class HeliTwinError(Exception):
    """Something the user can put right; the message is one sentence that says how."""
