"""Model-mismatch studies: many flights, on one machine or a cluster, and what they say about a controller.

A `Study` is a value, read from a file or made in Python; `run_study` flies what of it is new; `write_report` shows it.
"""

from heli_twin.studies.errors import StudyError

__all__ = ["StudyError"]
