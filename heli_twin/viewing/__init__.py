"""Flights in Rerun, live and from a log. Nothing else imports Rerun."""
