"""Which family a class belongs to, by the attributes that it has."""

import inspect
from dataclasses import fields
from typing import Any

from heli_twin.experiment.families import DESIGNS

_NEEDS = {
    "controllers.trajectories": ("flat",),
    "controllers.laws": ("period", "steps", "model", "start"),
    "controllers.estimators": ("lead", "start"),
    "controllers.excitations": ("excited",),
    "controllers.coordinations": ("planner_of",),
    "heli_twin.lab.plant": ("step", "start"),
    "heli_twin.lab.faults": ("hooks",),
    "heli_twin.lab.disturbances": ("start",),
    DESIGNS: ("adaptive", "check", "count", "batches"),
}
"""The attributes that tell the family of a class."""


def family_of(spec: type) -> str:
    """The family of a class: the one with the most attributes of which it has all; empty if there is none."""
    names = {f.name for f in fields(spec)} | set(dir(spec))
    fit = [package for package, needs in _NEEDS.items() if names.issuperset(needs)]
    family = max(fit, key=lambda package: len(_NEEDS[package]), default="")
    # Both only start: a disturbance with a generator, a supervisor with a model and a period.
    start: Any = getattr(spec, "start", None)
    if family == "heli_twin.lab.disturbances" and callable(start) and len(inspect.signature(start).parameters) == 3:
        return "controllers.supervisors"
    return family


def nearest_family(spec: type) -> str:
    """The family of a class or, if attributes are missing, that of which it has the most; empty if it has none."""
    names = {f.name for f in fields(spec)} | set(dir(spec))
    found = {package: len(names.intersection(needs)) - 0.5 * len(needs) for package, needs in _NEEDS.items()}
    best = max(found, key=lambda package: found[package])
    exact = family_of(spec)
    return best if found[best] > max(found.get(exact, 0.5), 0.5) or (not exact and found[best] >= 0.0) else exact


def needs_of_families() -> str:
    """The members of each family's classes, for a person: `trajectories flat; laws period, steps, model, start`."""
    return "; ".join(f"{package.rpartition('.')[2]} {', '.join(needs)}" for package, needs in _NEEDS.items())
