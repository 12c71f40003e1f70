"""Laws, estimators, faults and disturbances that use all that the contracts allow, flown, logged and read back."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers.trajectories.circle import Circle
from controllers.trajectories.takeoff_and_landing import TakeoffAndLanding
from heli_twin import ExperimentError, fly, load, read_log
from heli_twin.exchange.arrow_tables import table, tables
from heli_twin.flight import Flight
from heli_twin.lab.disturbances import ALONE, air_of, together
from heli_twin.lab.disturbances.gust import Gust
from heli_twin.lab.plant import STILL_AIR, Air
from heli_twin.lab.plant.ideal import Ideal
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.reanalysis.resolve import resolve, write
from heli_twin.recording import Recorder
from heli_twin.viewing.blueprint import Scales
from heli_twin.viewing.entities import rows
from heli_twin.viewing.live import Destination, show
from heli_twin.viewing.show import scales_of
from tests.own.detailed import DerivativeLaw, Everywhere, Tilted, Whirl
from tests.own.helix import Helix

LAB = load("lab", ["duration=2"])
HOVER = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def flown(**parts: Any) -> Any:
    return fly(replace(LAB, **parts), log_dir=None)


@pytest.fixture(scope="module")
def detailed() -> Any:
    return flown(controller=DerivativeLaw(), estimator=Tilted())


def test_a_law_reads_derivatives_and_its_plan_has_named_states(detailed: Any) -> None:
    log = detailed.log
    assert [state.name for state in log.plan_states] == ["tilt_x", "tilt_y", "rate_x", "rate_y"]
    assert log.plan_extra.x.shape == (len(log.plan.time), 6, 4)
    t = 1e-9 * log.estimate.stamp[5]
    wanted = Circle().derivatives(t + 0.02 * np.arange(6), 3)[2:, :, :2] / 9.81
    found = log.plan_extra.x[5].reshape(6, 2, 2).transpose(1, 0, 2)
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_an_estimate_has_named_states(detailed: Any) -> None:
    log = detailed.log
    assert [(s.name, s.unit) for s in log.estimate_states] == [("roll", "rad"), ("pitch", "rad")]
    np.testing.assert_array_equal(log.estimate_extra.time, log.estimate.time)
    np.testing.assert_array_equal(log.estimate_extra.stamp, log.estimate.stamp)
    # On the circle it leans inwards, as its pose says.
    assert np.abs(log.estimate_extra.x[50:]).max() > 0.01


def test_further_states_are_exported_by_name_and_unit(detailed: Any) -> None:
    rows = table(detailed.log, "/estimate_extra")
    assert rows.column_names == ["time", "stamp", "roll", "roll_variance", "pitch", "pitch_variance"]
    assert rows.schema.field("roll_variance").metadata == {b"unit": b"(rad)^2"}
    assert table(detailed.log, "/mpc/plan_extra").column_names == ["time", "tilt_x", "tilt_y", "rate_x", "rate_y"]
    assert "/estimate_extra" not in tables(flown().log)


def test_a_resolved_log_keeps_further_states_and_moments(tmp_path: Path) -> None:
    flight = flown(controller=DerivativeLaw(), estimator=Tilted(), disturbances=(Whirl(),))
    # Flown by a class of the user's own, so resolved with one of ours.
    log = replace(flight.log, experiment=flown(duration=0.1).log.experiment)
    write(log, resolve(log), tmp_path / "again.mcap")
    again = read_log(tmp_path / "again.mcap")
    np.testing.assert_array_equal(again.estimate_extra.x, log.estimate_extra.x)
    np.testing.assert_array_equal(again.disturbance_moment.moment, log.disturbance_moment.moment)


def test_a_trajectory_that_lacks_a_derivative_is_refused_before_the_flight() -> None:
    text = r"Helix gives .* up to the 2nd, and the 4th are asked for"
    for trajectory in (Helix(), TakeoffAndLanding(flight=Helix())):
        with pytest.raises(ExperimentError, match=text):
            flown(trajectory=trajectory, controller=DerivativeLaw())
    assert flown(trajectory=Helix()).outcome.kind == "completed"


def test_a_supervisor_s_way_down_has_derivatives_too() -> None:
    landed = flown(
        controller=DerivativeLaw(),
        faults=load("lab", ["faults.pose_outage.start=0.5", "faults.pose_outage.duration=9"]).faults,
        supervisor=load("lab", ["supervisor=safety"]).supervisor,
        duration=4.0,
    )
    assert landed.outcome.kind == "landed", landed.outcome


@pytest.mark.parametrize(("name", "text"), [("Tilt", "lower-case"), ("time", "other columns"), ("a_variance", "other")])
def test_a_name_that_a_log_cannot_hold_is_refused(name: str, text: str) -> None:
    class Odd(Tilted):
        """Names a state so."""

        extra_states = ((name, "rad"),)

    with pytest.raises(ExperimentError, match=f"estimator: extra_states has the name '{name}'.*{text}"):
        flown(estimator=Odd())


def test_a_fault_hooks_the_estimate_the_acting_command_and_the_battery() -> None:
    realistic = load("lab", ["duration=2", "trajectory=hover"])
    plain, faulty = (fly(replace(realistic, faults=faults), log_dir=None).log for faults in ((), (Everywhere(),)))
    assert faulty.estimate.x[0, 2] == plain.estimate.x[0, 2] + 0.01
    assert faulty.battery.voltage[0] == plain.battery.voltage[0] - 1.0
    # The radio has 341 steps from the middle to full stick.
    np.testing.assert_allclose(faulty.acting.u[1:] / 0.99 * 341, np.round(faulty.acting.u[1:] / 0.99 * 341), atol=1e-9)
    assert faulty.acting.time.max() <= 1_500_000_000 < plain.acting.time.max()
    # It believes itself 1 cm too high and flies lower.
    low, high = (log.truth.position[log.truth.time > 1_200_000_000, 2][0] for log in (faulty, plain))
    assert low < high


def test_a_moment_turns_the_helicopter_and_is_in_the_log() -> None:
    windless = replace(LAB, trajectory=load("lab", ["trajectory=hover"]).trajectory, disturbances=(Whirl(),))
    log = fly(windless, log_dir=None).log
    np.testing.assert_array_equal(log.disturbance_moment.moment, np.tile([0, 0, 1e-5], (len(log.disturbance.time), 1)))
    assert not len(flown().log.disturbance_moment.time)


def test_a_moment_accelerates_by_moment_over_inertia() -> None:
    spec = MuJoCo(yaw_damping=0.0)
    plant = spec.start(HOVER)
    plant.advance(500_000_000, np.array(spec.trim), STILL_AIR._replace(moment=np.array([0.0, 0.0, 2.7e-6])))
    # 2.7e-6 N m on 2.7e-5 kg m^2 is 0.1 rad/s^2; the gimbal's own mass is 1e-6 of it.
    assert plant.truth().yaw_rate == pytest.approx(0.05, rel=1e-4)


def test_a_moment_turns_with_the_body() -> None:
    spec = MuJoCo(yaw_damping=0.0, attitude_frequency=5.0)
    nose_up = np.array([0.0, -1e-5, 0.0])
    pitches = []
    for yaw in (0.0, 2.0):
        start = HOVER.copy()
        start[3] = yaw
        plant = spec.start(start)
        plant.advance(300_000_000, np.array(spec.trim), STILL_AIR._replace(moment=nose_up))
        w, x, y, z = plant.truth().quat_wxyz
        pitches.append(np.arcsin(2 * (w * y - z * x)))
        # The stiffness that drives it back is Iyy w^2.
        assert abs(pitches[-1]) > 0.25e-5 / (3.9e-5 * 25.0)
    assert pitches[0] == pytest.approx(pitches[1], rel=1e-9)


def test_a_flight_under_a_moment_in_pieces_is_the_flight_at_once() -> None:
    air = Air(np.array([0.1, 0.2, 0.0]), np.zeros(3), 1.0, np.array([1e-5, 2e-5, -1e-5]))
    ends = []
    for stops in ([300], [1, 20, 133, 300]):
        plant = MuJoCo().start(HOVER)
        for ms in stops:
            plant.advance(ms * 1_000_000, np.array(MuJoCo().trim), air)
        plant.advance(400_000_000, np.array(MuJoCo().trim), STILL_AIR)
        ends.append(plant.truth())
    np.testing.assert_array_equal(ends[0].quat_wxyz, ends[1].quat_wxyz)
    np.testing.assert_array_equal(ends[0].position, ends[1].position)


def test_a_plant_that_feels_no_moment_warns_once() -> None:
    log = fly(replace(LAB, plant=Ideal(), disturbances=(Whirl(),), duration=0.2), log_dir=None).log
    assert [event.text for event in log.events if event.name == "moment"] == [
        "a disturbance gives a moment, which does not act on this plant"
    ]


def test_moments_add_up() -> None:
    one, two = STILL_AIR._replace(moment=np.array([1.0, 2.0, 3.0])), STILL_AIR._replace(moment=np.ones(3))
    np.testing.assert_array_equal(together([one, STILL_AIR, two]).moment, [2, 3, 4])
    assert together([STILL_AIR]).moment is None


def test_a_disturbance_sees_the_others_if_it_asks() -> None:
    truth = Ideal().start(HOVER).truth()
    above = np.array([[0.1, 0.0, 1.5], [2.0, 0.0, 1.5]])
    whirl, gust = air_of(Whirl()), air_of(Gust().start(np.random.default_rng(0)))
    assert whirl(truth, above).wind[2] == -0.5
    assert whirl(truth, ALONE).wind[2] == 0.0
    assert np.isfinite(gust(truth, above).wind).all()


def test_a_flight_hands_on_where_the_others_are() -> None:
    experiment = replace(LAB, disturbances=(Whirl(),), duration=0.1)
    with Recorder() as recorder:
        flight = Flight(experiment, experiment.plant.start(HOVER), recorder)
        flight.others = np.array([[0.0, 0.0, 2.0]])
        flight.run()
        recorder.close("completed", 1)
    assert (recorder.log().disturbance.wind[:, 2] == -0.5).all()


def test_further_states_are_drawn_live_and_from_the_log(detailed: Any, tmp_path: Path) -> None:
    for scales in (scales_of(detailed.experiment), Scales().for_log(detailed.log)):
        shown = {entity for entity, times, _ in rows(detailed.log, scales) if len(times)}
        assert {"states/roll/estimate", "states/pitch/estimate"} <= shown
    show(detailed.log, Destination(file=tmp_path / "flight.rrd"), scales_of(detailed.experiment))
    assert (tmp_path / "flight.rrd").stat().st_size > 0
