"""Gains and damping of the helicopter from flight logs: what `heli-twin identify` finds.

`flights.py` says what to fly, `data.py` makes equations of poses and commands, `fit.py` solves them, `identify.py` puts
them together and `figure.py` draws what is left over.

Source: Kunz, Huck, Summers, ECC 2013, section on identification, (27).
"""
