from contextlib import suppress
from dataclasses import dataclass, fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers import reference
from controllers.errors import InfeasibleTrajectory
from controllers.flatness import FlatOutput, feed_forward, state
from controllers.model import Model
from controllers.reference import ReferencePreview, check_feasible
from controllers.trajectories.circle import Circle
from controllers.trajectories.hover import Hover
from heli_twin.experiment.families import members

MS = 1_000_000
PERIOD = 20 * MS
CIRCLE = Circle(rate=1.7, ramp=1.0)
X, Y, Z, YAW = range(4)


@given(
    st.integers(-5 * PERIOD, 5 * PERIOD),
    st.lists(st.tuples(st.integers(-30, 3000), st.integers(1, 61)), min_size=1, max_size=8),
)
def test_a_preview_is_the_trajectory_from_its_stamp_on(origin, asked):
    preview = ReferencePreview(CIRCLE, Model(), PERIOD, origin)
    # Forwards, backwards and in leaps: what was asked before must not matter.
    for k, steps in asked:
        stamp = origin + k * PERIOD
        reference = preview(stamp, steps)
        t = 1e-9 * np.maximum(stamp + PERIOD * np.arange(steps + 1), 0)
        assert reference.stamp == stamp
        # Vectorised sines may differ in their last digit.
        np.testing.assert_allclose(reference.x, state(CIRCLE.flat(t)), rtol=0, atol=1e-13)
        np.testing.assert_allclose(reference.u, feed_forward(Model(), CIRCLE.flat(t[:-1])), rtol=0, atol=1e-13)


def test_a_preview_is_whole_at_every_step_of_a_long_flight():
    preview = ReferencePreview(CIRCLE, Model(), PERIOD, 0)
    whole = state(CIRCLE.flat(0.02 * np.arange(2020)))
    for k in range(2000):
        # Times in nanoseconds and in seconds, each rounded, at 1.7 rad/s and up to 60 rad.
        np.testing.assert_allclose(preview(k * PERIOD, 19).x, whole[k : k + 20], rtol=0, atol=1e-12)


@given(st.integers(-1000 * PERIOD, 1000 * PERIOD), st.integers(1, PERIOD - 1))
def test_a_stamp_off_the_grid_is_an_error(origin, off):
    preview = ReferencePreview(CIRCLE, Model(), PERIOD, origin)
    with pytest.raises(ValueError, match=f"stamp {origin + off} ns is not on the grid {origin}"):
        preview(origin + off, 3)


@dataclass(frozen=True)
class Moving:
    """Rest at 1 m, and from 3 s on one axis that does what it is told."""

    axis: int
    z: float = 0.0
    dz: float = 0.0
    ddz: float = 0.0

    def flat(self, t):
        late = np.asarray(t) >= 3.0
        flat = FlatOutput(*(np.zeros((len(t), 4)) for _ in range(3)))
        flat.z[:, Z] = 1.0
        for values, value in zip(flat, (self.z, self.dz, self.ddz), strict=True):
            values[late, self.axis] += value
        return flat


INFEASIBLE = {
    "pitch input u_x = 1.05, the limit is 1": Moving(X, ddz=2.1),
    "pitch input u_x = -1.05, the limit is -1": Moving(X, ddz=-2.1),
    "roll input u_y = 1.1, the limit is 1": Moving(Y, ddz=2.31),
    "thrust input u_z = 1.1, the limit is 1": Moving(Z, ddz=9.99),
    "thrust input u_z = -0.1, the limit is 0": Moving(Z, ddz=-11.61),
    "yaw input u_yaw = 0.5, the limit is 0.4": Moving(YAW, ddz=55.5),
    "forward speed vx = 3.1 m/s, the limit is 3 m/s": Moving(X, dz=3.1, ddz=-0.5 * 3.1),
    "forward speed vx = -3.1 m/s, the limit is -3 m/s": Moving(X, dz=-3.1, ddz=0.5 * 3.1),
    "sideward speed vy = 3.1 m/s, the limit is 3 m/s": Moving(Y, dz=3.1, ddz=-0.4 * 3.1),
    "vertical speed vz = 2.1 m/s, the limit is 2 m/s": Moving(Z, dz=2.1),
    "yaw rate = 26 rad/s, the limit is 25 rad/s": Moving(YAW, dz=26.0, ddz=-5 * 26.0),
    "height above the floor = -0.5 m, the limit is 0 m": Moving(Z, z=-1.5),
    "position x = inf m, the limit is 1e+06 m": Moving(X, z=np.inf),
    "yaw = -1e+07 rad, the limit is -1e+06 rad": Moving(YAW, z=-1e7),
    "pitch input u_x = nan, the limit is 1": Moving(X, ddz=np.nan),
    "vertical speed vz = inf m/s, the limit is 2 m/s": Moving(Z, dz=np.inf),
}


@pytest.mark.parametrize(("complaint", "trajectory"), INFEASIBLE.items(), ids=list(INFEASIBLE))
def test_what_cannot_be_flown_is_named_with_its_time_and_limit(complaint, trajectory):
    with pytest.raises(InfeasibleTrajectory) as refusal:
        check_feasible(trajectory, Model(), 10.0, 0.02)
    assert f"at t = 3.00 s it needs {complaint}; make it slower" in str(refusal.value)


def test_the_first_trouble_is_named_whatever_its_kind():
    class FastThenHard:
        def flat(self, t):
            fast, hard = Moving(Z, dz=2.1).flat(t), Moving(X, ddz=3.0).flat(np.asarray(t) - 1.0)
            return FlatOutput(fast.z, fast.dz, hard.ddz)

    with pytest.raises(InfeasibleTrajectory, match=r"at t = 3\.00 s it needs vertical speed"):
        check_feasible(FastThenHard(), Model(), 10.0, 0.02)


def test_the_last_sample_of_a_flight_is_checked_where_it_is_the_first_of_a_block():
    class Sinks:
        def flat(self, t):
            flat = Hover().flat(t)
            return flat._replace(z=flat.z - np.outer(t >= end, [0.0, 0.0, 2.0, 0.0]))

    end = reference.BLOCK_SAMPLES * 0.02
    with pytest.raises(InfeasibleTrajectory, match="floor"):
        check_feasible(Sinks(), Model(), end, 0.02)
    check_feasible(Sinks(), Model(), end - 0.02, 0.02)


@pytest.mark.parametrize("trajectory", INFEASIBLE.values(), ids=list(INFEASIBLE))
def test_trouble_after_the_flight_does_not_matter(trajectory):
    check_feasible(trajectory, Model(), 2.99, 0.02)


def test_the_believed_limits_count():
    # 0.5 m, from rest: the yaw input of a circle at 1 rad/s is (0.75 + 5 * 0.5) / 111 at most, 0.045.
    check_feasible(CIRCLE, Model(), 30.0, 0.02)
    with pytest.raises(InfeasibleTrajectory, match=r"yaw input u_yaw = .*, the limit is 0\.04;"):
        check_feasible(CIRCLE, replace(Model(), u_yaw_max=0.04), 30.0, 0.02)


def test_a_limit_may_be_reached():
    check_feasible(Moving(Z, dz=2.0), Model(), 10.0, 0.02)
    check_feasible(Moving(Z, dz=-2.0), Model(), 10.0, 0.02)


KINDS = [kind for _, kind in sorted(members("controllers.trajectories").items())]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("extreme", [1e308, -1e308, 1e154, 5e-324])
def test_extreme_values_are_flown_or_refused_without_a_warning(kind, extreme):
    for field in fields(kind):
        default = getattr(kind(), field.name)
        if field.name in ("points", "rows"):
            last = len(default) - 1
            values = [(*default[:-1], (*default[last][:i], extreme, *default[last][i + 1 :])) for i in range(1, 4)]
        else:
            values = [extreme] if isinstance(default, float) else []
        for value in values:
            with suppress(InfeasibleTrajectory):
                check_feasible(replace(kind(), **{field.name: value}), Model(), 5.0, 0.02)
