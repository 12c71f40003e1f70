"""Classes of a user's own in an experiment: they fly as they are, but no text describes them.

In the text of an experiment such a member is marked with its class and a hash of the class's source. So its flight has
another digest than that of a member of heli_twin, and a text with the mark is never read back as something else.
"""

import hashlib
import inspect
from functools import cache
from typing import Any, get_args

from controllers.markers import EachOf
from heli_twin.experiment.families import members
from heli_twin.experiment.fields import FieldInfo
from heli_twin.experiment.values import ExperimentError

OWN = "own_class"
"""Key of the mark in a member's table."""


def own_class(value: Any, info: FieldInfo) -> str:
    """Return the mark of a part of an experiment: its class and a hash of the source; empty for heli_twin's own.

    Args:
        value: The part: a member of a family or a table of fields.
        info: The field in which it stands.
    """
    known = members(info.family.package).values() if info.family else [info.type]
    return "" if type(value) in known else _mark(type(value))


@cache
def _mark(spec: type) -> str:
    try:
        source = hashlib.sha256(inspect.getsource(spec).encode()).hexdigest()[:16]
    except (OSError, TypeError):
        source = "unknown"
    return f"{spec.__name__}, source {source}"


def refuse_own(table: Any, path: str) -> None:
    """Refuse a table with the mark of a user's class.

    Raises:
        ExperimentError: It has the mark.
    """
    if isinstance(table, dict) and OWN in table:
        raise ExperimentError(
            f"{path} is of its user's own class ({str(table[OWN])[:80]!r}), which no text describes: fly it from the"
            " Python program that has the class, or name a member of heli_twin in its place"
        )


def interface(info: FieldInfo) -> list[str]:
    """Return the attributes that a member of a field's family needs."""
    # Of `EachOf` the type is `tuple[Member | Named[Member], ...]`.
    protocol = get_args(info.type)[0] if isinstance(info.family, EachOf) else info.type
    protocol = next(iter(get_args(protocol)), protocol)
    return sorted(name for name in dir(protocol) if not name.startswith("_"))
