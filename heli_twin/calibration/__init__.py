"""Calibration: the twin of one particular helicopter, from logs of its flights.

`flights.py` defines the flights, `data.py` cuts logs into windows of poses and commands, `drive.py` is the path of a
command to the actuators, `motion.py` the twin's equations for many windows and parameters at once, `noise.py` the
covariance of gusts and cameras, `fit.py` the fit, `structure.py` what is left over, `calibrate.py` puts them together,
`planning.py` says what a flight would tell, and `output.py` writes the files.

Sources: Jategaonkar, Flight Vehicle System Identification, 2nd ed. (2015), chapters 4 and 5 (output error, process
noise); Patterson and Thompson, Biometrika 58 (1971) (REML).
"""
