"""Classes of a user's own in an experiment: they fly as they are, and a text marks them.

The mark is the name of the class and a hash of the source of its module. So a flight has another digest than that of a
member of heli_twin, and a text with the mark is never read back as something else: the class has to be there, named by
the user (`--with ./my_law.py`) or installed. No code and no path comes from a log.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, get_args

from controllers.laws.external import External
from controllers.markers import EachOf, by_name
from controllers.programs import at_hand, is_marked
from heli_twin.experiment import Experiment
from heli_twin.experiment.families import GROUPS, HELI_TWIN, all_members
from heli_twin.experiment.fields import FieldInfo, fields_of
from heli_twin.experiment.named_classes import source_hash
from heli_twin.experiment.values import ExperimentError

OWN = "own_class"
"""Key of the mark in a member's table."""


def own_class(value: Any, info: FieldInfo) -> str:
    """Return the mark of a part of an experiment: its class and a hash of its source; empty for heli_twin's own.

    Args:
        value: The part: a member of a family or a table of fields.
        info: The field in which it stands.
    """
    if info.family is None:
        return "" if type(value) is info.type else mark_of(type(value))
    kind = getattr(value, "kind", None)
    known = all_members(info.family.package).get(kind) if isinstance(kind, str) else None
    return "" if known and known.spec is type(value) and known.origin == HELI_TWIN else mark_of(type(value))


def mark_of(spec: type) -> str:
    """The mark of a class of a user's own."""
    return f"{spec.__name__}, source {source_hash(spec)}"


def own_classes(spec: Any, here: str = "") -> Iterator[tuple[str, type]]:
    """Yield the dotted path and the class of each part of an experiment that is of a class of a user's own."""
    for name, info in fields_of(type(spec)).items():
        if info.is_plain:
            continue
        value, path = getattr(spec, name), f"{here}{name}"
        for part in by_name(value).values() if isinstance(info.family, EachOf) else (value,):
            if own_class(part, info):
                yield path, type(part)
            yield from own_classes(part, f"{path}.")


def without_mark(table: Any, path: str, package: str | None = None) -> Any:
    """A table without its mark, if the class that it stands for is there.

    Args:
        table: What stands in the experiment.
        path: Its dotted path.
        package: Of its family; None for a table that is no member.

    Raises:
        ExperimentError: The class is not there.
    """
    if not isinstance(table, dict) or OWN not in table:
        return table
    mine = all_members(package).get(str(table.get("kind"))) if package else None
    if mine is None or mine.origin == HELI_TWIN:
        raise _absent(table[OWN], path)
    return {key: value for key, value in table.items() if key != OWN}


def require_own(mark: Any, path: str) -> None:
    """Refuse the mark of a class that has not been named.

    Args:
        mark: As `mark_of` gives it.
        path: Dotted path of the part.

    Raises:
        ExperimentError: No class with this mark is here.
    """
    here = (member.spec for package in GROUPS for member in all_members(package).values() if member.origin != HELI_TWIN)
    if mark not in map(mark_of, here):
        raise _absent(mark, path)


class ClassMissing(ExperimentError):
    """A class of a user's own that an experiment was flown with, and that is not here."""


def _absent(mark: Any, path: str) -> ExperimentError:
    return ClassMissing(
        f"{path} is of a class of its user's own, {str(mark)[:80]!r}, which is not here: name the file or the"
        " import path of the class, as in --with ./my_law.py, or a member of heli_twin in its place"
    )


def other_sources(tree: Any, spec: type = Experiment, here: str = "") -> Iterator[str]:
    """A sentence for each part of a logged experiment whose class is here with another source than the logged one."""
    if not isinstance(tree, dict):
        return
    for name, info in fields_of(spec).items():
        if info.family is None:
            continue
        tables = tree.get(name)
        parts = tables if isinstance(info.family, EachOf) else {"": tables}
        for key, table in (parts if isinstance(parts, dict) else {}).items():
            if isinstance(table, dict) and OWN in table:
                mine = all_members(info.family.package).get(str(table.get("kind")))
                if mine and (mark := mark_of(mine.spec)) != table[OWN]:
                    path = f"{here}{name}.{key}".rstrip(".")
                    yield f"{path} was flown by {str(table[OWN])[:80]!r}, here it is {mark!r} of {mine.origin}"


def refuse_commands(tree: Any) -> None:
    """Refuse a foreign text whose external law names a program that could be run: it has to name it by its marks.

    Raises:
        ExperimentError: It does not.
    """
    law = tree.get("controller") if isinstance(tree, dict) else None
    command = law.get("command") if isinstance(law, dict) and law.get("kind") == EXTERNAL else None
    if command is not None and not (_is_texts(command) and is_marked(command)):
        raise ExperimentError(
            f"controller.command = {str(command)[:80]!r}: in a log or a store a program is named by its name and hash,"
            " as pid@0123456789abcdef, and no program is run because they say so"
        )


def _is_texts(words: Any) -> bool:
    return isinstance(words, list) and all(isinstance(word, str) for word in words)


def with_commands(value: Any, change: Callable[[list[str]], Sequence[str]], key: str = "") -> Any:
    """Tables and lists of a study or an experiment with every command in them changed.

    Args:
        value: A table, a list or a single value.
        change: From the words of a command to its new words; a single text is a command of one word.
        key: The name under which the value stands, maybe a dotted path.
    """
    is_command = key.rpartition(".")[2] == "command"
    if isinstance(value, dict):
        return {name: with_commands(inner, change, key if is_command else name) for name, inner in value.items()}
    if is_command and isinstance(value, str):
        return list(change([value]))
    if not isinstance(value, list | tuple):
        return value
    if is_command and value and _is_texts(list(value)):
        return list(change(list(value)))
    return type(value)(with_commands(inner, change, key) for inner in value)


def with_program_at_hand(experiment: Experiment) -> Experiment:
    """The same experiment; a program that it names by its marks, and that is not here, is the one of `--with`."""
    law = experiment.controller
    if not isinstance(law, External) or at_hand(law.command) == law.command:
        return experiment
    return replace(experiment, controller=replace(law, command=at_hand(law.command)))


def other_program(tree: Any, experiment: Experiment) -> Iterator[str]:
    """A sentence if another program is here than the logged one.

    Args:
        tree: The logged experiment.
        experiment: The same, with the program that is here.
    """
    law = experiment.controller
    logged = tree.get("controller", {}).get("command")
    if isinstance(law, External) and logged != list(law.command):
        flown, here = (" ".join(map(str, words))[:150] for words in (logged or (), law.command))
        yield f"controller was flown by the program {flown!r}, here it is {here!r}"


EXTERNAL = "external"
"""The kind of the law that is a program."""


def interface(info: FieldInfo) -> list[str]:
    """Return the attributes that a member of a field's family needs."""
    # Of `EachOf` the type is `tuple[Member | Named[Member], ...]`.
    protocol = get_args(info.type)[0] if isinstance(info.family, EachOf) else info.type
    protocol = next(iter(get_args(protocol)), protocol)
    return sorted(name for name in dir(protocol) if not name.startswith("_"))
