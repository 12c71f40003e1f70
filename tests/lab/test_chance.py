import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from controllers.signals import nanoseconds
from heli_twin.lab.chance import BLOCK, blocks, coloured, generator

seeds = st.integers(0, 2**53)
names = st.sampled_from(["mocap", "radio", "compute", "gust", "bias", "battery"])


@given(seeds, names)
def test_a_stream_is_given_by_seed_and_name(seed, name):
    np.testing.assert_array_equal(generator(seed, name).random(8), generator(seed, name).random(8))


@given(seeds, names, names)
def test_two_components_have_streams_of_their_own(seed, one, other):
    assume(one != other)
    # Eight doubles of 53 bits do not agree by luck.
    assert not np.array_equal(generator(seed, one).random(8), generator(seed, other).random(8))


@given(seeds, seeds, names)
def test_two_seeds_have_streams_of_their_own(one, other, name):
    assume(one != other)
    assert not np.array_equal(generator(one, name).random(8), generator(other, name).random(8))


@given(seeds, st.permutations(["mocap", "radio", "gust"]), st.lists(st.integers(0, 20), min_size=3, max_size=3))
def test_what_one_draws_and_when_does_not_shift_another(seed, order, counts):
    alone = {name: generator(seed, name).random(30) for name in order}
    streams = {name: generator(seed, name) for name in (*order, "one more component")}
    streams["one more component"].random(1000)
    for name, count in zip(order, counts, strict=True):
        np.testing.assert_array_equal(streams[name].random(count), alone[name][:count])
    for name, count in zip(order, counts, strict=True):
        np.testing.assert_array_equal(streams[name].random(5), alone[name][count : count + 5])


def test_streams_are_the_same_on_every_machine():
    """A golden value: an old log's experiment has to fly again."""
    np.testing.assert_array_equal(generator(0, "gust").integers(0, 1000, 5), [865, 108, 589, 895, 274])


@given(seeds, names, st.integers(1, 3))
def test_blocks_are_the_numbers_drawn_one_instant_at_a_time(seed, name, width):
    drawn = blocks(generator(seed, name).standard_normal, width)
    alone = generator(seed, name)
    for block in (next(drawn), next(drawn)):
        assert block.shape == (BLOCK, width)
        np.testing.assert_array_equal(block, [alone.standard_normal(width) for _ in range(BLOCK)])


@given(seeds, st.floats(0, 1), st.integers(1, 5))
def test_a_coloured_process_keeps_its_share_and_goes_on_over_blocks(seed, keep, cut):
    shocks, before = generator(seed, "gust").standard_normal((6, 2)), np.array([2.0, -1.0])
    whole = coloured(before, keep, shocks)
    x = before
    for value, shock in zip(whole, shocks, strict=True):
        x = keep * x + shock
        np.testing.assert_array_equal(value, x)
    first = coloured(before, keep, shocks[:cut])
    np.testing.assert_array_equal(np.concatenate([first, coloured(first[-1], keep, shocks[cut:])]), whole)


@given(st.integers(0, 3600 * 1000))
def test_a_duration_in_milliseconds_is_exact(ms):
    assert nanoseconds(ms / 1000) == ms * 1_000_000
