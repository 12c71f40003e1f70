import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from controllers.signals import Command
from heli_twin.experiment.families import members
from heli_twin.lab.radio import NEVER_NS, Dsm2, NoRadio, Turn

MS = 1_000_000
U = np.array([0.1, -0.2, 0.545, 0.03])


def generated(seed):
    return np.random.default_rng(seed)


def command(stamp, u=U):
    return Command(stamp, np.asarray(u, float))


def link(seed=0, **fields):
    return Dsm2(**fields).start(np.random.default_rng(seed))


def flown(radio, ready, until):
    """(time, stamp) of everything that the receiver takes over, asked whenever it is due."""
    ready, held, t = list(ready), [], 0
    while t <= until:
        while ready and ready[0] <= t:
            at = ready.pop(0)
            radio.send(at, command(at))
        if t >= radio.due and (received := radio.receive(t)):
            held.append((t, received.stamp))
        t = min([radio.due, until + 1, *ready[:1]])
    return held


@pytest.mark.parametrize("kind", list(members("heli_twin.lab.radio")))
def test_every_radio_delivers_the_newest_command_and_only_once(kind):
    radio = members("heli_twin.lab.radio")[kind]().start(np.random.default_rng(0))
    assert radio.due >= 0
    assert radio.receive(radio.due - 1) is None
    radio.send(5 * MS, command(0))
    radio.send(6 * MS, command(1))
    held = []
    for t in range(0, 100 * MS, MS):
        if t >= radio.due and (received := radio.receive(t)):
            held.append(received)
        assert radio.due > t
    assert held[-1].stamp == 1
    assert len({h.stamp for h in held}) == len(held)


@given(st.integers(0, 1000), st.floats(0.001, 0.1), st.floats(0, 0.1))
def test_frames_come_at_their_period_and_phase_whatever_is_sent(seed, frame_period, latency):
    spec = {"frame_period": frame_period, "latency": latency, "loss": 0.0}
    idle, busy = link(seed, **spec), link(seed, **spec)
    due = []
    for _ in range(5):
        due.append(idle.due)
        busy.send(busy.due - round(latency * 1e9), command(0))
        assert idle.receive(idle.due) is None
        assert busy.receive(busy.due) is not None
        assert busy.due == idle.due
    period = round(frame_period * 1e9)
    np.testing.assert_array_equal(np.diff(due), period)
    assert 0 <= due[0] - round(latency * 1e9) < period


def test_phases_differ_from_flight_to_flight():
    due = [link(seed).due for seed in range(200)]
    # Uniform over 22 ms: 200 draws leave no gap of a quarter of it (1e-24).
    assert np.diff(sorted(due)).max() < 5.5 * MS


def test_a_command_takes_the_wait_for_a_frame_and_the_air_time():
    ready = range(6 * MS, 20_000 * MS, 20 * MS)
    for at, stamp in flown(link(3, loss=0.0), ready, 20_000 * MS):
        assert 5 * MS <= at - stamp <= 27 * MS


def test_of_two_commands_in_one_frame_the_first_is_never_flown():
    ready = list(range(6 * MS, 44_000 * MS, 20 * MS))
    held = flown(link(3, loss=0.0), ready, 44_000 * MS)
    # 20 ms of control against 22 ms of frames: every eleventh command is overwritten. The ends count for one each.
    assert len(held) == pytest.approx(len(ready) * 20 / 22, abs=2)
    assert (np.diff([stamp for _, stamp in held]) > 0).all()


@pytest.mark.parametrize("loss", [0.0, 0.1, 1.0])
def test_frames_are_lost_as_often_as_is_said(loss):
    radio, frames = link(1, loss=loss, failsafe=0.0), 2000
    lost = 0
    for _ in range(frames):
        radio.send(radio.due - 5 * MS, command(radio.due))
        lost += radio.receive(radio.due) is None
    # A coin thrown 2000 times, at 0.1 % on either side.
    assert binom.ppf(0.001, frames, loss) <= lost <= binom.ppf(0.999, frames, loss)


def test_after_a_lost_frame_the_next_one_brings_the_newest():
    radio = link(0, loss=1.0)
    radio.send(0, command(1))
    radio.send(0, command(2))
    assert radio.receive(radio.due + 100 * MS) is None
    heard = link(0, loss=0.0)
    heard.send(0, command(1))
    heard.send(0, command(2))
    assert heard.receive(heard.due).stamp == 2
    assert heard.receive(heard.due) is None


def test_a_late_command_does_not_replace_a_newer_one():
    """Compute latency may vary by more than a control period."""
    radio = link(0, loss=0.0)
    radio.send(90 * MS, command(0))
    radio.send(25 * MS, command(20))
    stamps = [h.stamp for t in range(0, 300 * MS, MS) if (h := radio.receive(t))]
    assert stamps == [20]


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4), st.integers(2, 2000))
def test_inputs_arrive_in_steps_of_full_travel_over_the_levels(u, levels):
    radio = link(0, levels=levels, loss=0.0)
    radio.send(0, command(0, u))
    held = radio.receive(radio.due).u
    # Half a step is the most that rounding takes; and the steps are whole.
    assert np.abs(held - u).max() <= 1 / levels + 1e-15
    steps = held * levels / 2
    np.testing.assert_allclose(steps, np.round(steps), rtol=0, atol=1e-12)
    assert np.abs(held).max() <= 1 + 1 / levels


def test_losses_do_not_depend_on_what_is_sent():
    """Shared random numbers: two controllers meet the same losses."""
    often, seldom = link(5, loss=0.3), link(5, loss=0.3)
    got = []
    for k in range(300):
        often.send(often.due - 6 * MS, command(k))
        if k % 3 == 0:
            seldom.send(seldom.due - 6 * MS, command(k))
        got.append((often.receive(often.due) is not None, seldom.receive(seldom.due) is not None))
    lost = np.array([not a for a, _ in got])
    # Where the busy link heard nothing, the frame was lost, for the other one too.
    assert lost.sum() > 50
    assert not np.array([b for _, b in got])[lost].any()


@given(st.lists(st.integers(0, 50), min_size=1, max_size=10))
def test_no_radio_is_a_wire(waits):
    wire = NoRadio().start(np.random.default_rng(0))
    assert wire.due == NEVER_NS
    at = 0
    for k, wait in enumerate(waits):
        at += wait * MS
        wire.send(at, command(k))
    # Everything that is ready by then; the newest acts, unquantised.
    received = wire.receive(at)
    assert received.stamp == len(waits) - 1
    np.testing.assert_array_equal(received.u, U)
    assert wire.due == NEVER_NS
    assert wire.receive(at + MS) is None


def test_a_wire_waits_until_the_command_is_ready():
    wire = NoRadio().start(np.random.default_rng(0))
    wire.send(7 * MS, command(0))
    assert wire.due == 7 * MS
    assert wire.receive(7 * MS - 1) is None
    assert wire.receive(7 * MS).stamp == 0


def test_without_commands_the_receiver_takes_its_own_once_and_then_obeys_again():
    radio = link(failsafe=0.5, failsafe_thrust=0.2, loss=0.0)
    held = flown(radio, [0, 2000 * MS], 3000 * MS)
    stamps = [stamp for _, stamp in held]
    assert stamps == [0, -1, 2000 * MS, -1]
    # Half a second after the last command, at the next frame.
    assert 500 * MS <= held[1][0] - held[0][0] < 522 * MS
    radio = link(failsafe=0.5, failsafe_thrust=0.2)
    while not (own := radio.receive(radio.due)):
        pass
    np.testing.assert_array_equal(own.u, [0.0, 0.0, 0.2, 0.0])


def test_the_failsafe_begins_when_its_time_is_over():
    radio = link(failsafe=0.5)
    assert radio.receive(500 * MS - 1) is None
    assert radio.receive(500 * MS).stamp == -1


def test_without_a_failsafe_the_last_command_stays_in_force():
    assert [stamp for _, stamp in flown(link(failsafe=0.0, loss=0.0), [0], 5000 * MS)] == [0]


def test_one_transmitter_serves_each_in_turn():
    """Frame k is of helicopter k modulo n, whatever each loses."""
    first = Dsm2().start(generated(5)).due
    for number in range(3):
        radio = Dsm2(loss=0.3).start_in_turn(generated(number), generated(5), Turn(number, 3))
        held = flown(radio, range(0, 20_000 * MS, MS), 20_000 * MS)
        frames = {(t - first) // (22 * MS) for t, _ in held if (t - first) % (22 * MS) == 0}
        assert len(frames) == len(held)
        assert {k % 3 for k in frames} == {number}
        # 303 frames in 20 s, of which 30 % are lost: the standard deviation is 2.6 %.
        assert len(held) == pytest.approx(0.7 * 303, abs=5 * 8)
        # The command of the millisecond before the frame, 5 ms later.
        assert all(5 * MS <= t - stamp < 6 * MS for t, stamp in held)
