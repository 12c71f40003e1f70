"""What reports are made of: figures as values, intervals, words for numbers, and HTML pages."""
