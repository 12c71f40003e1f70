"""Gains and damping of the helicopter, identified from flight logs by `heli-twin identify`.

`flights.py` defines the flights, `data.py` turns poses and commands into equations, `fit.py` solves them, `identify.py`
puts the axes together and `figure.py` plots the residuals.

Source: Kunz, Huck, Summers, ECC 2013, section on identification, (27).
"""
