import pytest

from heli_twin.experiment.text import load
from heli_twin.mission import Result, fly

PUSHED_OUT = ["volume.half_width=0.501", "disturbances.bias.x=5"]


def flown(*changes: str) -> Result:
    return fly(load("ideal", ["plant=mujoco", "duration=2", *changes]), log_dir=None)


@pytest.mark.parametrize("limits", [[], ["plant.thrust_gain=0.4"], ["controller.model.u_z_max=0.8"]])
def test_a_helicopter_too_heavy_to_hover_crashes_and_the_heaviest_that_hovers_is_told(limits) -> None:
    crash = flown("plant.mass=0.06", *limits)
    assert crash.outcome.kind == "crashed"
    assert "too heavy to hover: plant.mass = 0.06 kg weighs 0.5886 N, its largest thrust is" in crash.outcome.text
    assert crash.log.ending.text == crash.summary()["outcome_text"] == crash.outcome.text
    heaviest = float(crash.outcome.text.removesuffix(" kg").rpartition(" ")[2])
    for mass, is_told in ((heaviest, False), (heaviest + 2e-5, True)):
        again = flown(f"plant.mass={mass}", *PUSHED_OUT, *limits)
        assert again.outcome.kind == "left_volume"
        assert ("too heavy" in again.outcome.text) == is_told
