"""Model-mismatch studies: many flights, on one machine or a cluster, and what they say about a controller.

A `Study` is a value, read from a file or made in Python; `run` flies what of it is new and returns the rows; and
`write_report` shows them.
"""

from pathlib import Path

from heli_twin.studies.errors import StudyError

__all__ = ["PAGE", "STUDIES", "StudyError"]

STUDIES = Path("logs/studies")
"""The default folder of results, one folder a study."""
PAGE = "report.html"
"""The name of the page of a study, of its progress and of its report."""
