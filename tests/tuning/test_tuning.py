from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from math import log, pi
from types import SimpleNamespace

import numpy as np
import pytest

from controllers.laws.detailed_mpc import DetailedMpc
from controllers.laws.ltv_mpc import LtvMpc
from controllers.laws.pid import Pid
from controllers.model import Model
from controllers.reference import check_feasible
from controllers.trajectories.hover import Hover
from heli_twin.cli import main
from heli_twin.errors import HeliTwinError
from heli_twin.experiment.text import load
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.metrics.margins import Margins
from heli_twin.metrics.tracking import AXES
from heli_twin.mission import fly
from heli_twin.tuning import search
from heli_twin.tuning.search import FAILED_COST, REACH_LOG, SEED_OFFSETS, moves, shares, start_gains, tune, with_gains
from heli_twin.tuning.ultimate_gain import Ringing, Ultimate, border, find_ultimate, ringing

MODEL = Model()
PID = Pid()
LAB = load("lab_simple", ["controller=pid"])


def test_the_rules_are_ziegler_and_nichols():
    # The classic table: 0.6 Ku, 1.2 Ku / Tu, 0.075 Ku Tu; numbers measured with 45 ms of delay.
    assert Ultimate("x", 1.60, 3.57, 0.0).gains() == pytest.approx((0.96, 0.54, 0.43), abs=0.005)
    assert Ultimate("yaw", 0.64, 0.82, 0.0).gains() == pytest.approx((0.39, 0.95, 0.039), abs=0.015)
    # What an axis was given first it keeps.
    assert Ultimate("z", 1.6, 3.57, 0.3).gains()[2] == pytest.approx(0.73, abs=0.005)


@pytest.mark.parametrize("edge", [0.02, 0.7, 1.0, 9.0])
def test_the_border_is_found_from_either_side(edge):
    asked = []

    def ring(gain):
        asked.append(gain)
        return Ringing(0.3 * log(gain / edge), 2.0)

    gain, period = border(ring, 1.0, "gain")
    # Raised by 1.4, then four times cut to three quarters at most.
    assert gain == pytest.approx(edge, rel=0.06)
    assert period == 2.0
    assert len(asked) < 20


def test_an_axis_that_never_rings_is_told():
    with pytest.raises(HeliTwinError, match="gain of z has no limit below 50"):
        border(lambda gain: Ringing(-1.0, 1.0), 1.0, "gain of z")


def rung(growth, period, size=0.1, u=0.5):
    t = np.arange(0.0, 20.0, 0.02)
    x = np.zeros((len(t), 8))
    x[:, 2] = 1.0 + size * np.exp(growth * t) * np.sin(2 * pi * t / period)
    stamp = np.round(1e9 * t).astype(np.int64)
    inputs = np.tile([0.0, 0.0, u, 0.0], (len(t), 1))
    return SimpleNamespace(estimate=SimpleNamespace(stamp=stamp, x=x), sent=SimpleNamespace(u=inputs))


@pytest.mark.parametrize("growth", [-0.05, 0.02])
def test_growth_and_period_of_a_ringing_are_measured(growth):
    found = ringing(rung(growth, 1.7), "z", 1.0, PID)
    # Windows of five periods and a bit.
    assert found.growth == pytest.approx(growth, abs=0.01)
    assert found.period == pytest.approx(1.7, rel=0.02)


def test_noise_has_died_out_and_a_limited_motion_has_grown():
    assert ringing(rung(0.02, 1.7, size=1e-3), "z", 1.0, PID).growth < 0.0
    assert ringing(rung(-0.02, 1.7, u=1.0), "z", 1.0, PID).growth > 0.0


@pytest.mark.parametrize(("share", "growing"), [(0.19, False), (0.21, True)])
def test_a_fifth_of_the_commands_at_a_limit_is_a_motion_that_has_grown(share, growing):
    log = rung(-0.02, 1.7)
    u = log.sent.u[-(len(log.sent.u) // 2) :]
    u[: round(share * len(u)), 2] = 1.0
    assert (ringing(log, "z", 0.0, PID).growth > 0.0) is growing


def test_the_ultimate_gain_of_a_known_plant_is_the_one_of_theory():
    delay = 0.06
    base = load("ideal", ["controller=pid", f"mocap.latency={delay}", "estimator.roll_forward=false"])
    found = find_ultimate(base, "yaw")
    # b / (s (s - k)) with the delay and half a period of the hold: the phase is -180 deg where
    # w late + atan(w / -k) = 90 deg, and Ku is 1 / |G| there.
    late = delay + 0.5 * PID.period
    w = np.linspace(1.0, 40.0, 40_000)
    w = w[np.argmin(np.abs(w * late + np.arctan(w / -MODEL.k_yaw) - pi / 2))]
    gain = w * np.hypot(w, MODEL.k_yaw) / MODEL.b_yaw
    # The sampling of poses at the control steps and the filter are not in this.
    assert found.gain == pytest.approx(gain, rel=0.1)
    assert found.period == pytest.approx(2 * pi / w, rel=0.1)
    assert found.damping == 0.0


def test_only_a_pid_has_an_ultimate_gain():
    with pytest.raises(HeliTwinError, match="controller=pid"):
        find_ultimate(load("lab"), "x")


def test_the_moves_can_be_flown_and_end_where_they_began():
    path = moves()
    check_feasible(path, MODEL, path.times[-1], 0.02)
    start, end = path.flat(np.array([0.0, path.times[-1]])).z
    np.testing.assert_allclose(start, end, atol=1e-12)


def test_shares_are_the_cost_of_26():
    experiment = replace(LAB, trajectory=Hover(yaw=0.0), duration=3.0)
    flight = fly(experiment, log_dir=None).log
    x = np.column_stack([flight.truth.position, flight.truth.yaw, flight.truth.velocity, flight.truth.yaw_rate])
    # The last state has no command.
    x, x_ref, n = x[: len(flight.sent.stamp)], flight.reference.x, len(flight.sent.stamp)
    e, du = x - x_ref[:n], flight.sent.u - flight.reference.u[:n]
    weights = LtvMpc()
    whole = np.mean((np.array(weights.Q[:8]) * e**2).sum(axis=1) + (np.array(weights.R) * du**2).sum(axis=1))
    found = shares(flight)
    # In hover, turning the error to the heading changes its split only; the weights of x and y are equal.
    assert sum(found.values()) == pytest.approx(whole, rel=1e-6)
    assert set(found) == set(AXES)


def wires(yaw, yaw_ref, position=(0.0, 0.0, 0.0), velocity_ref=(0.0, 0.0, 0.0), du=(0.0, 0.0, 0.0, 0.0)):
    """One control step of a flight at rest as a log: the truth, a reference at the origin and the command."""
    stamp, still = np.array([0]), np.zeros((1, 3))
    truth = SimpleNamespace(
        stamp=stamp, position=np.array([position]), yaw=np.array([yaw]), velocity=still, yaw_rate=np.zeros(1)
    )
    x_ref = np.array([[0.0, 0.0, 0.0, yaw_ref, *velocity_ref, 0.0]])
    reference = SimpleNamespace(stamp=stamp, x=x_ref, u=np.array([MODEL.u_hover]))
    sent = SimpleNamespace(stamp=stamp, u=np.array([MODEL.u_hover]) + du)
    return SimpleNamespace(truth=truth, reference=reference, sent=sent)


@pytest.mark.parametrize(
    ("flight", "axis", "cost"),
    [
        # The nose points west: a metre north is a metre to starboard.
        (wires(pi / 2, pi / 2, position=(0.1, 0.0, 0.0)), "y", LtvMpc().Q[1] * 0.01),
        (wires(pi / 2, pi / 2, position=(0.0, 0.1, 0.0)), "x", LtvMpc().Q[0] * 0.01),
        (wires(0.3, 0.3, position=(0.0, 0.0, -0.1)), "z", LtvMpc().Q[2] * 0.01),
        # 0.2 rad across the seam of angles.
        (wires(pi - 0.1, 0.1 - pi), "yaw", LtvMpc().Q[3] * 0.04),
        # It should fly ahead, along its own nose, and stands.
        (wires(2.0, 2.0, velocity_ref=(0.5, 0.0, 0.0)), "x", LtvMpc().Q[4] * 0.25),
        # Ahead of a reference that points the other way is backwards for it, and its yaw is half a turn off.
        (wires(0.0, pi / 2, velocity_ref=(0.0, 0.5, 0.0)), "x", LtvMpc().Q[4] * 0.25),
        (wires(0.0, 0.0, du=(0.0, 0.0, 0.1, 0.0)), "z", LtvMpc().R[2] * 0.01),
    ],
)
def test_each_error_costs_its_weight_on_its_axis(flight, axis, cost):
    assert shares(flight)[axis] == pytest.approx(cost)


def bowl(best, experiment):
    """A cost that is known: squared distance in logarithms from gains `best`, apart by axis."""
    gains = start_gains(experiment.controller)
    return {a: 0.01 + sum(log(g / best[n]) ** 2 for n, g in names.items()) for a, names in gains.items()}


FACTORS = {"p": 3.0, "i": 0.5, "d": 1.0}
BEST = {f"{term}_{a}": getattr(PID, f"{term}_{a}") * factor for a in AXES for term, factor in FACTORS.items()}


@pytest.fixture
def known_cost(monkeypatch):
    monkeypatch.setattr(search, "_cost", partial(bowl, BEST))

    # Doubled gains must not decide here.
    def flights(search, gains):
        return [replace(search._base, controller=with_gains(search._law, gains))] * len(SEED_OFFSETS)

    monkeypatch.setattr(search._Search, "_flights", flights)


@pytest.mark.usefixtures("known_cost")
def test_the_search_finds_the_bottom_of_a_bowl():
    found = tune(LAB, map, budget=200)
    for names in found.best.gains.values():
        for name, gain in names.items():
            # Three digits and the last step, a sixteenth of the first.
            assert gain == pytest.approx(BEST[name], rel=0.05)
    assert max(found.best.cost.values()) < 0.02 < min(found.start.cost.values())
    assert start_gains(found.law) == found.best.gains


@pytest.mark.usefixtures("known_cost")
@pytest.mark.parametrize("budget", [1, 5, 20])
def test_the_search_keeps_its_budget_and_never_gets_worse(budget):
    told = []
    found = tune(LAB, map, budget, progress=lambda: told.append(1))
    assert found.trials == len(told) == budget
    assert all(found.best.cost[a] <= found.start.cost[a] for a in AXES)
    assert tune(LAB, map, budget) == found


@pytest.mark.usefixtures("known_cost")
def test_gains_stay_within_reach(monkeypatch):
    monkeypatch.setattr(search, "_cost", partial(bowl, dict.fromkeys(BEST, 1000000.0)))
    found = tune(LAB, map, 300)
    for axis, names in found.best.gains.items():
        for name, gain in names.items():
            # Three digits.
            assert gain == pytest.approx(found.start.gains[axis][name] * np.exp(REACH_LOG), rel=0.005)


@pytest.mark.usefixtures("known_cost")
def test_a_start_that_does_not_fly_is_told(monkeypatch):
    monkeypatch.setattr(search, "_cost", lambda e: dict.fromkeys(AXES, FAILED_COST))
    with pytest.raises(HeliTwinError, match="cannot fly the moves"):
        tune(LAB, map, 3)


def test_gains_go_in_and_come_out():
    for law in (PID, LtvMpc(), DetailedMpc()):
        gains = start_gains(law)
        assert with_gains(law, gains) == law
        doubled = {a: {n: 2 * g for n, g in names.items()} for a, names in gains.items()}
        assert start_gains(with_gains(law, doubled)) == doubled


def test_a_pid_is_judged_with_doubled_gains_too():
    flown = []

    def run(work, flights):
        flown.extend(flights)
        # The doubled one rings.
        return [dict.fromkeys(AXES, 1.0)] * 2 + [dict.fromkeys(AXES, 5.0)] + [dict.fromkeys(AXES, 1.0)] * 2

    found = tune(LAB, run, 1)
    assert [e.controller.p_x / PID.p_x for e in flown] == [1.0, 1.0, 2.0, 1.0, 1.0]
    assert found.best.cost == dict.fromkeys(AXES, 2.5)


def test_every_law_is_judged_with_slow_and_fast_attitudes_and_an_mpc_with_a_helicopter_that_answers_twice():
    flown = []

    def run(work, flights):
        flown.extend(flights)
        return [dict.fromkeys(AXES, cost) for cost in (1.0, 1.0, 1.0, 7.0, 3.0)]

    found = tune(replace(LAB, controller=DetailedMpc()), run, 1)
    assert [e.plant.attitude_frequency for e in flown] == [14.0, 14.0, 14.0, 10.0, 18.0]
    assert [e.plant.pitch_gain / MuJoCo().pitch_gain for e in flown] == [1.0, 1.0, 2.0, 1.0, 1.0]
    assert found.best.cost == dict.fromkeys(AXES, 7.0)


def test_what_is_printed_flies(monkeypatch, tmp_path, capsys, rise_version):
    def run(work, items):
        if list(items) == list(AXES):
            return [Ultimate(a, 1.0, 1.0, 0.0) for a in AXES]
        return [dict.fromkeys(AXES, 1.0)] * len(items)

    monkeypatch.setattr("heli_twin.workers.fleet.fleet", lambda: nullcontext(run))
    margins = Margins(2.0, np.inf, 1.5, 3.0)
    monkeypatch.setattr("heli_twin.tuning.margins.law_margins", lambda experiment: dict.fromkeys(AXES, margins))
    for kind, law in (("pid", Pid), ("mpc", LtvMpc), ("detailed", DetailedMpc)):
        file = tmp_path / f"{kind}.toml"
        assert main(["tune", kind, "controller.period=0.04", "--budget", "2", "--save", str(file)]) == 0
        printed = capsys.readouterr().out
        assert file.read_text() in printed
        assert "2.00 │         none │ 1.50 │ 3.0 rad/s" in printed
        saved = load(str(file)).controller
        assert isinstance(saved, law)
        assert saved.period == 0.04
        assert load("ideal", [f"controller={file}"]).controller == saved
    assert load(str(tmp_path / "pid.toml")).controller.p_x == 0.6
    as_saved = load(str(file))
    rise_version()
    assert load(str(file)) == load("lab", ["estimator=detailed_kalman", f"controller={file}"]) == as_saved


def test_a_budget_of_nothing_is_refused(capsys):
    assert main(["tune", "pid", "--budget", "0"]) == 2
    assert "leaves nothing to try" in capsys.readouterr().err
