"""Recorded flights as figures for papers, drawn by matplotlib without a window. One file here is one kind of figure."""

from heli_twin.plots.figure import KINDS, FlightFigure, plot, save

__all__ = ["KINDS", "FlightFigure", "plot", "save"]
