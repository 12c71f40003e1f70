"""Many flights on many processes, of one machine or a cluster."""
