"""A digital twin of a 28 g coaxial helicopter and the lab it flies in.

`fly(Experiment())` flies; `load("lab", ["plant.mass=0.03"])` makes an experiment from text; `read_log` opens a log.
"""

from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.text import load
from heli_twin.mission import Result, fly
from heli_twin.recording import read_log

__all__ = ["Experiment", "HeliTwinError", "Result", "fly", "load", "read_log"]
