"""Building blocks of reports: figures as values, intervals, numbers with units, and HTML pages."""
