"""Flights in Rerun, live and from a log. Nothing else imports Rerun."""

import os

_before = os.environ.get("RUST_LOG")
# Rerun reads this once, when it is imported. Its own log would only repeat our sentences on the terminal.
os.environ["RUST_LOG"] = _before or "off"
import rerun as rerun  # noqa: E402

if _before is None:
    del os.environ["RUST_LOG"]
