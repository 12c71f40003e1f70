"""Flight logs: written to MCAP while flying, read back as NumPy columns.

`Recorder` has one method for each topic. `read_log` returns a `Log`; all metrics, figures and pictures come from it.
"""

from heli_twin.recording.log import Log
from heli_twin.recording.reader import read_log
from heli_twin.recording.records import Attachment, Ending, Event, Origin, OutcomeKind
from heli_twin.recording.recover import recover
from heli_twin.recording.schema import LogError, LogExistsError, Severity
from heli_twin.recording.writer import Recorder

__all__ = [
    "Attachment",
    "Ending",
    "Event",
    "Log",
    "LogError",
    "LogExistsError",
    "Origin",
    "OutcomeKind",
    "Recorder",
    "Severity",
    "read_log",
    "recover",
]
