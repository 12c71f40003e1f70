"""Outages in the lab with the supervisor on: it flies on, or lands near the place where it stopped."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.rotations import wrap_angle
from heli_twin import fly, load
from heli_twin.reanalysis.resolve import resolve

HOUR = 3600.0
FIRST_LOST = 4.0


def outage(trajectory, length, seed, *words, preset="lab"):
    overrides = ["supervisor=safety", *words, f"trajectory={trajectory}", "faults.pose_outage=on"]
    # Another moment of the circle with every seed.
    start = FIRST_LOST + 0.37 * seed % 4
    experiment = load(
        preset, [*overrides, f"faults.pose_outage.start={start}", f"faults.pose_outage.duration={length}"]
    )
    return fly(replace(experiment, seed=seed, duration=start + min(length, 2.0) + 3.0), log_dir=None)


def time_of(log, phase):
    return next((event.time for event in log.events if event.name == phase), None)


def landing(log):
    """Way from where levelling began to the touch-down (m), and the speed there (m/s)."""
    touched = next(event for event in log.events if event.name == "touch_down")
    place = {t: log.truth.position[log.truth.time == t][0, :2] for t in (time_of(log, "levelling"), touched.time)}
    return float(np.linalg.norm(np.subtract(*place.values()))), float(touched.text.split()[-2])


def flights(preset, trajectory, length, seeds):
    """Fly them; nobody leaves the room or crashes, and who lost the poses for too long has landed."""
    ways = []
    for seed in seeds:
        result = outage(trajectory, length, seed, preset=preset)
        log = result.log
        blind_on = time_of(log, "landing") is not None
        assert result.outcome.kind == ("landed" if blind_on else "completed"), (seed, result.outcome)
        assert blind_on == (length > 0.75)
        assert np.abs(log.truth.position[:, :2]).max() < 1.2
        if blind_on:
            way, speed = landing(log)
            ways.append(way)
            assert speed < 1.0
            assert log.truth.touching[-1]
            assert not log.sent.u[-1].any()
            assert log.truth.position[-1, 2] == pytest.approx(0.045, abs=0.001)
        elif time_of(log, "coasting") is not None:
            assert [event.name for event in log.events if event.text == "the poses are back"]
    return ways


@pytest.mark.parametrize("preset", ["lab", "lab_simple"])
@pytest.mark.parametrize("trajectory", ["hover", "circle"])
@pytest.mark.parametrize(("length", "seeds"), [(0.3, [0]), (0.7, [1]), (1.0, [6]), (HOUR, [0, 1])])
def test_an_outage_ends_in_the_air_or_on_the_floor(preset, trajectory, length, seeds):
    ways = flights(preset, trajectory, length, seeds)
    assert max(ways, default=0.0) < 0.5


@pytest.mark.long
@pytest.mark.parametrize("preset", ["lab", "lab_simple"])
@pytest.mark.parametrize("trajectory", ["hover", "circle"])
def test_outages_of_any_length(preset, trajectory):
    # Every outage that is longer than the way down ends in the same flight.
    for length in (0.1, 0.2, 0.5, 0.7, 1.0, 1.5, 2.0, HOUR):
        ways = flights(preset, trajectory, length, range(20))
        if ways:
            print(
                f"{preset} {trajectory} {length} s: median {100 * np.median(ways):.1f}, worst {100 * max(ways):.1f} cm"
            )
            assert np.median(ways) < 0.2
            assert max(ways) < 0.5


@pytest.mark.parametrize("law", ["controller=pid", "controller.terminal=riccati", "controller.coupling=full"])
def test_any_law_lands_softly(law):
    result = outage("circle", HOUR, 1, law)
    assert result.outcome.kind == "landed"
    assert landing(result.log)[1] < 0.9


def test_the_problems_of_a_landing_are_solved_again_as_they_were():
    log = outage("circle", HOUR, 0).log
    again = resolve(log)
    np.testing.assert_array_equal(np.array([command.u for command in again.commands]), again.flown)


@pytest.mark.parametrize("preset", ["lab", "lab_simple"])
def test_a_takeoff_begins_and_a_landing_ends_on_the_floor_with_the_motors_off(preset):
    words = ["trajectory=takeoff_and_landing", "trajectory.flight=hover", "trajectory.airborne=2", "duration=20"]
    result = fly(load(preset, [*words, "supervisor=safety"]), log_dir=None)
    log = result.log
    assert result.outcome.kind == "landed"
    phases = [event.name for event in log.events if event.name in ("ready", "flying", "landed")]
    assert phases == ["ready", "flying", "landed"]
    lifted = log.truth.time < time_of(log, "flying")
    assert log.truth.touching[lifted][5:].all()
    assert np.abs(log.truth.position[lifted] - [0.0, 0.0, 0.045]).max() < 0.001
    assert log.truth.position[:, 2].max() == pytest.approx(1.0, abs=0.02)
    touched = next(event for event in log.events if event.name == "touch_down")
    # The speed at which it is meant to meet the floor.
    assert float(touched.text.split()[-2]) < load(preset, ["supervisor=safety"]).supervisor.touch_speed
    yaw = wrap_angle(log.truth.yaw - log.reference.x[:, 3])
    assert np.degrees(np.abs(yaw)).max() < 3.0
    assert log.truth.touching[-1]
    assert log.truth.position[-1, 2] == pytest.approx(0.045, abs=0.001)
    assert not log.sent.u[-1].any()
    assert not log.acting.u[-1].any()


def test_a_flight_without_trouble_is_the_same_with_and_without_a_supervisor():
    with_it, without = (
        fly(load("lab", [f"supervisor={kind}", "duration=4"]), log_dir=None).log for kind in ("safety", "off")
    )
    np.testing.assert_array_equal(with_it.truth.position, without.truth.position)
    assert [event.name for event in with_it.events if event not in without.events] == ["flying"]
