"""Families of interchangeable parts, found by looking at the files: a new member needs no registry."""

from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType


@cache
def members(package: str) -> dict[str, type]:
    """The specs of a family by their `kind`, in alphabetical order.

    A member is a dataclass defined in the module, or in any module of the package, with a field `kind`.
    """
    home = import_module(package)
    rooms = iter_modules(getattr(home, "__path__", []))
    modules: list[ModuleType] = [home, *(import_module(f"{package}.{room.name}") for room in rooms)]
    kinds = {}
    for module in modules:
        for value in vars(module).values():
            if isinstance(value, type) and is_dataclass(value) and value.__module__ == module.__name__:
                kinds.update({f.default: value for f in fields(value) if f.name == "kind"})
    return dict(sorted(kinds.items()))
