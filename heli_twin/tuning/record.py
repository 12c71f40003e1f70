"""The tuning record: `heli-twin tune --save` writes it, and reports say from it where a controller's gains come from.

The record is a comment at the head of the saved file, so that the file can be flown as it is; as in PEP 723, it is TOML
between two marker lines. A study that names the file, `controller = "pid.toml"`, copies the record as a plain table.
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
"""`controller`, the table of the tuned controller, and facts about the tuning: trials, budget, seeds, ..."""

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
    """The record in the comment of a TOML file, as TOML; empty if there is none."""
    block = _BLOCK.search(text)
    return re.sub(r"^# ", "", block[1], flags=re.MULTILINE) if block else ""


def origin(law: ControlLaw, records: Iterable[Record] = ()) -> str:
    """Say in words where a controller's gains come from.

    A controller that equals a record's, apart from its `model`, was tuned as the record says. Any other is described as
    its class with some fields changed; the last paragraph of the class's docstring says where the defaults come from.
    """
    mine, default = table_of(law), table_of(type(law)())
    for record in records:
        tuned = default | dict(record["controller"])
        if tuned | {"model": mine["model"]} == mine:
            facts = [
                f"{name.replace('_', ' ')} {_shown(value)}" for name, value in record.items() if name != "controller"
            ]
            return f"{mine['kind']}, tuned{_but_for(mine, tuned)}: {', '.join(facts)}"
    paragraphs = [text for text in (getdoc(type(law)) or "").split("\n\n") if not text.startswith("Fields:")]
    words = " ".join(paragraphs[-1].split()) if paragraphs else ""
    differs = _but_for(mine, default)
    return f"{mine['kind']}, default values{differs + ', no tuning record' if differs else ''}: \u201c{words}\u201d"


def _but_for(table: Tree, other: Tree) -> str:
    changed = [f"{change.path} = {_shown(change.after)}" for change in changes(other, table)]
    return f" but for {', '.join(changed)}" if changed else ""


def _shown(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
