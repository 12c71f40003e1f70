"""What crossed the wires: recorded to MCAP while flying, read back as NumPy columns, shown in Rerun.

`Recorder` has one method a wire. `read_log` gives a `Log`, and from it come all metrics, figures and pictures. Rerun
is imported by the viewer bridge only, which is not imported here.
"""

from heli_twin.recording.log import Attachment, Event, Log
from heli_twin.recording.reader import read_log
from heli_twin.recording.recover import recover
from heli_twin.recording.schema import LogError, LogExistsError
from heli_twin.recording.writer import Recorder

__all__ = ["Attachment", "Event", "Log", "LogError", "LogExistsError", "Recorder", "read_log", "recover"]
