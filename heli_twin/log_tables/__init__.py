"""Tables over many logs: what was flown, how it ended, how well."""
