"""Many flights in many processes, on one machine or on a cluster."""
