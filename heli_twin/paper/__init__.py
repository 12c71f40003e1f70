"""The paper, flown again and judged: what `heli-twin paper` does. `write.py` is the whole in order.

Source: Kunz, Huck, Summers, "Fast Model Predictive Control of Miniature Helicopters", ECC 2013.
"""
