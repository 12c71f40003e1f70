"""Validation: a twin beside flights that it was not fitted to.

`twins.py` says which twins are compared, `forecast.py` predicts pieces of a flight in open loop, `agreement.py`
measures the errors of the predictions, `closed_loop.py` flies the twin as the helicopter was flown, and `validate.py`
puts them together and gives the verdict.

Sources: Jategaonkar, Flight Vehicle System Identification, 2nd ed. (2015), chapter 11 (model validation).
"""
