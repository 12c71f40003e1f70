"""Several helicopters in one room: flown together by one loop into one log."""
