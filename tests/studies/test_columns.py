"""The outcome of a flight in a study: what it was meant to do counts."""

import pytest

from heli_twin import fly, load
from heli_twin.studies.columns import columns

TAKE_OFF = ["trajectory=takeoff_and_landing", "trajectory.flight=hover", "trajectory.airborne=0.5"]
LOST = ["trajectory=hover", "trajectory.height=0.3", "faults.pose_outage=on", "faults.pose_outage.start=0.2"]


@pytest.mark.parametrize(
    ("words", "outcome"),
    [
        ([*TAKE_OFF, "trajectory.climb=1.5", "trajectory.ramp=0.5", "duration=9"], "completed"),
        ([*LOST, "faults.pose_outage.duration=60", "duration=5"], "landed"),
        ([*LOST, "faults.pose_outage.duration=60", "duration=1"], "completed"),
    ],
)
def test_a_landing_that_was_planned_completes_a_flight_and_another_is_an_outcome_of_its_own(words, outcome):
    experiment = load("lab", words)
    log = fly(experiment, log_dir=None).log
    row = columns(log, experiment)
    assert row["outcome"] == outcome
    assert row["outcome_text"] == log.ending.text
    assert log.outcome == ("completed" if "duration=1" in words else "landed")
