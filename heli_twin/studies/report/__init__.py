"""The report of a study: one HTML page that needs no network, and one SVG a figure."""

from heli_twin.studies.report.page import write_report

__all__ = ["write_report"]
