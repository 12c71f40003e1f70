"""Nested metrics as one table."""

import math
from collections.abc import Mapping
from typing import Any


def flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as one, names joined by dots; non-finite numbers become None."""
    row: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            row |= flat(value, f"{prefix}{key}.")
        else:
            row[prefix + key] = None if isinstance(value, float) and not math.isfinite(value) else value
    return row
