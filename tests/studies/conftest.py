"""Small studies, and work that goes wrong on purpose."""

import sys
from pathlib import Path

import pytest

from heli_twin.studies.study import Study, study_of

# Workers load what they run by its name.
sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def small() -> Study:
    """Six flights of a moment each, of the ideal helicopter with a gust."""
    return study_of(
        {
            "name": "small",
            "base": {"preset": "ideal", "duration": 2.6, "disturbances": {"gust": "on"}},
            "axes": {"disturbances.gust.strength": [0.1, 0.3, 0.5]},
            "replicates": 2,
            "logs": {"worst": 1, "sampled": 0},
        }
    )
