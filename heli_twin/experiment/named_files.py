"""The files that an experiment names, read into it, so that it is complete before it is flown.

The content of a model, the rows of a CSV file, the classes of a user's own: a path in a log or a store is followed by
nobody.
"""

import csv
import re
from pathlib import Path
from typing import Any

from controllers.markers import FileContent
from heli_twin.experiment.named_classes import is_reference, own_member_in
from heli_twin.experiment.places import content_field_at, family_at
from heli_twin.experiment.values import ExperimentError
from heli_twin.terminal_text import clean


def with_content(path: str, value: Any, folder: Path) -> Any:
    """Return a value with the content of each file that it names, where a field holds the content of a file.

    Args:
        path: Dotted path of a field or a table; empty for a whole experiment.
        value: The value, a table, or a list of values, as for an axis of a study.
        folder: Where the files are.

    Raises:
        ExperimentError: A file cannot be read, or its content is refused.
    """
    if isinstance(value, dict):
        return {key: with_content(f"{path}.{key}".lstrip("."), inner, folder) for key, inner in value.items()}
    if isinstance(value, list):
        return [with_content(path, inner, folder) for inner in value]
    if not isinstance(value, str) or not _CONTENT_FILE.fullmatch(value):
        return value
    field = content_field_at(path)
    return value if field is None else _content(folder / value, field, path)


def _content(file: Path, field: FileContent, path: str) -> str:
    try:
        return field.read(file)
    except OSError as error:
        reason = "there is no such file" if isinstance(error, FileNotFoundError) else error.strerror
        raise ExperimentError(
            f"{path}: cannot read {clean(error.filename or file.absolute(), 200)}: {reason}"
        ) from None
    except ValueError as error:
        raise ExperimentError(f"{path}: {error}") from None


_CONTENT_FILE = re.compile(r"[^<>\n]+\.xml")


def is_content(value: Any) -> bool:
    """Return whether a value is the content of a file, not its name."""
    return isinstance(value, str) and value.lstrip().startswith("<")


def with_members(path: str, value: Any, folder: Path) -> Any:
    """Return a value with the kind of each class of a user's own that it names by a file or an import path.

    The classes are loaded here, where the user names them, and nowhere else: code that a log or a store names is
    loaded by nobody.

    Args:
        path: Dotted path of a field or a table; empty for a whole experiment.
        value: The value, a table, or a list of values, as for an axis of a study.
        folder: Where the files are.

    Raises:
        FamilyError: A class cannot be loaded, or its kind belongs to another member.
    """
    if isinstance(value, dict):
        return {key: with_members(f"{path}.{key}".lstrip("."), inner, folder) for key, inner in value.items()}
    if isinstance(value, list):
        return [with_members(path, inner, folder) for inner in value]
    if not isinstance(value, str) or not is_reference(value) or not (family := family_at(path, ends=("", "kind"))):
        return value
    return own_member_in(folder, family, value)


def rows_of(file: str, columns: tuple[str, ...], path: str) -> list[list[float]]:
    """Read a CSV file: its rows become part of the experiment, so that a log can be flown without the file."""
    line = 1
    if not Path(file).is_file():
        raise ExperimentError(f"{path}: cannot read {clean(Path(file).absolute(), 200)}: there is no such file")
    try:
        with Path(file).open(encoding="utf-8-sig", newline="") as text:
            table = csv.DictReader(text, skipinitialspace=True, strict=True)
            missing = [column for column in columns if column not in (table.fieldnames or ())]
            if missing:
                raise ExperimentError(
                    f"{path}: {clean(file, 200)} has no column {missing[0]}; its first line has to name"
                    f" {', '.join(columns)}"
                )
            rows: list[list[float]] = []
            for row in table:
                line = table.line_num
                rows.append([float(row[column] or "") for column in columns])
    except OSError as error:
        raise ExperimentError(f"{path}: cannot read {clean(Path(file).absolute(), 200)}: {error.strerror}") from None
    except (ValueError, csv.Error) as error:
        raise ExperimentError(
            f"{path}: {clean(file, 200)}, line {line} is not a row of numbers: {clean(error, 100)}"
        ) from None
    return rows
