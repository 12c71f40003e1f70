"""How a controller came by its gains: the record that `heli-twin tune --save` leaves, and what a report says of it.

The record stands in the comment that the saved file begins with, so that the file flies as it is; as PEP 723 does for
scripts, it is TOML between two lines of slashes. A study that names the file, `controller = "pid.toml"`, carries the
record along as a plain table.
"""

import json
import re
from collections.abc import Iterable, Mapping
from inspect import getdoc
from typing import Any

from controllers.laws import ControlLaw
from heli_twin.experiment.differences import changes
from heli_twin.experiment.tree import Tree, table_of

Record = Mapping[str, Any]
"""`controller`, the table that the tuning found, and whatever else there is to tell: trials, budget, seeds, ..."""

_BLOCK = re.compile(r"^# /// tuning$\n((?:^# .*$\n)*?)^# ///$", re.MULTILINE)


def comment(record: Record) -> str:
    """A record as the comment of a TOML file."""
    lines = [f"# {name} = {_toml(value)}" for name, value in record.items()]
    return "\n".join(["# /// tuning", *lines, "# ///"])


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{name} = {_toml(inner)}' for name, inner in value.items())} }}"
    return json.dumps(value, ensure_ascii=False)


def uncommented(text: str) -> str:
    """The record in the comment of a TOML file, as TOML; empty where there is none."""
    found = _BLOCK.search(text)
    return re.sub(r"^# ", "", found[1], flags=re.MULTILINE) if found else ""


def origin(law: ControlLaw, records: Iterable[Record] = ()) -> str:
    """Where a controller's gains come from, as far as anything says so.

    A controller that is what a record found, but for its `model`, was tuned as the record tells. Any other is its
    class with some fields changed, of whose tuning nothing is known; the last paragraph of the class's docstring says
    where its defaults come from.
    """
    mine, default = table_of(law), table_of(type(law)())
    for record in records:
        found = default | dict(record["controller"])
        if found | {"model": mine["model"]} == mine:
            facts = [
                f"{name.replace('_', ' ')} {_shown(value)}" for name, value in record.items() if name != "controller"
            ]
            return f"{mine['kind']}, tuned{_but_for(mine, found)}: {', '.join(facts)}"
    words = " ".join((getdoc(type(law)) or "").split("\n\n")[-1].split())
    differs = _but_for(mine, default)
    return f"{mine['kind']}, default values{differs + ', no tuning record' if differs else ''}: \u201c{words}\u201d"


def _but_for(table: Tree, other: Tree) -> str:
    changed = [f"{change.path} = {_shown(change.after)}" for change in changes(other, table)]
    return f" but for {', '.join(changed)}" if changed else ""


def _shown(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
