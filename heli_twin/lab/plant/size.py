"""The outer size of the mCX2, from its centre of gravity, m; as `models/mcx2.xml` draws it."""

RADIUS_M = 0.095
"""Of the rotor discs."""
BELOW_M, ABOVE_M = 0.047, 0.076
"""Down to the skids and up to the bar, upright."""
LOWER_ROTOR_M = 0.027
"""Up to the underside of the lower rotor."""
