"""A flight in Rerun: the same pictures from a finished log and while it flies.

Only this module and the layout import Rerun, and nothing imports them before a viewer is asked for. A viewer that is
missing, or that dies, costs its pictures and nothing else.
"""

import logging
import socket
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rerun as rr

from heli_twin.recording.layout import Scales, layout, style
from heli_twin.recording.log import Log, Messages, Times

TIMELINE = "sim_time"
HOST, PORT = "127.0.0.1", 9876
SLICE = 500_000_000
"""Simulated ns that are sent at once while flying."""
TRAIL_STEP = 0.02
"""Length in time of one piece of the flown trail, s: one control period."""
ROTOR_RATE = 1.7
"""How fast the drawn rotors turn, rev/s: slow enough to see which way."""
"""
"""
