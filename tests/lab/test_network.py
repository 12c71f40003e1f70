"""Messages between ground stations: late, lost for each receiver by itself, and all by keyed chance."""

import numpy as np

from controllers.coordinations import Message
from heli_twin.lab.chance import generator
from heli_twin.lab.network import Network

NAMES = ("a", "b", "c")


def sent(spec: Network, messages: int = 1000, step: int = 10_000_000) -> list[tuple[int, str, int]]:
    """When each message arrives, at whom, and when it was sent."""
    network = spec.start(NAMES, generator(1, "network"))
    for k in range(messages):
        network.send(k * step, Message("a", k * step, None, 0))
    return [(d.at, d.receiver, d.message.stamp) for d in network.arrived(1 << 62)]


def test_all_others_get_each_message_after_the_delay():
    arrived = sent(Network(delay=0.003, jitter=0.0), messages=3)
    assert arrived == [(k * 10_000_000 + 3_000_000, name, k * 10_000_000) for k in range(3) for name in ("b", "c")]


def test_jitter_is_a_mean_and_messages_can_overtake():
    arrived = sent(Network(delay=0.003, jitter=0.01))
    late = np.array([at - stamp for at, _, stamp in arrived]) * 1e-9 - 0.003
    # The mean of 2000 exponential numbers errs by 2 %; five times that.
    assert late.min() >= 0.0
    assert abs(late.mean() - 0.01) < 0.001
    assert [stamp for _, _, stamp in arrived] != sorted(stamp for _, _, stamp in arrived)


def test_each_receiver_loses_its_own_share():
    arrived = sent(Network(loss=0.3))
    heard = [{stamp for _, receiver, stamp in arrived if receiver == name} for name in ("b", "c")]
    # Standard deviation of a share of 1000 is 1.4 %.
    assert all(abs(len(each) - 700) < 70 for each in heard)
    assert abs(len(heard[0] & heard[1]) - 490) < 80


def test_nobody_hears_anybody_in_an_outage():
    stamps = {stamp for _, _, stamp in sent(Network(outage_start=1.0, outage=2.0))}
    assert stamps == {k * 10_000_000 for k in range(1000) if not 100 <= k < 300}


def test_what_one_sends_does_not_change_the_luck_of_the_next():
    """Chance is drawn for each message in turn, whoever sends it."""
    network, other = (Network(loss=0.5).start(NAMES, generator(1, "network")) for _ in range(2))
    for k in range(100):
        network.send(k, Message("a", k, None, 0))
        other.send(k, Message("b", k, None, 0))
    c = [[d.message.stamp for d in each.arrived(1 << 62) if d.receiver == "c"] for each in (network, other)]
    assert c[0] == c[1]


def test_a_message_arrives_once():
    network = Network().start(NAMES, generator(1, "network"))
    network.send(0, Message("a", 0, None, 0))
    assert network.arrived(0) == []
    assert len(network.arrived(10**9)) == 2
    assert network.arrived(10**9) == []
