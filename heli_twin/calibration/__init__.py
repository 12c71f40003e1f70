"""Calibration: the twin of one particular helicopter, from logs of its flights.

`flights.py` defines the flights, `data.py` cuts logs into windows of poses and commands, `drive.py` is the path of a
command to the actuators, `motion.py` the twin's equations for many windows and parameters at once, `noise.py` what
gusts and cameras add to them, as a Kalman filter, `frames.py` finds when radio and servos take over a command, `fit.py`
defines the fit, `structure.py` what is left over, `calibrate.py` puts them together, `planning.py` says what a flight
would tell, and `output.py` writes the files.

Sources: Jategaonkar, Flight Vehicle System Identification, 2nd ed. (2015), chapters 4 and 5 (output error, process
noise); Patterson and Thompson, Biometrika 58 (1971) (REML).
"""
