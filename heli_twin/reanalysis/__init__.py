"""A recorded flight worked through again: flown, its control problems solved, its poses estimated."""
