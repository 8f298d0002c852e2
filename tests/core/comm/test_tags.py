from hypothesis import given
from hypothesis import strategies as st

from hpcpic.core.comm.tags import CHANNELS, WINDOW, Channel, tag

GUARANTEED = 32767  # MPI_TAG_UB is at least this


@given(st.integers(-2, 10**12), st.integers(0, CHANNELS - 1))
def test_tags_are_within_the_guaranteed_bound(iteration, channel):
    assert 0 <= tag(iteration, channel) <= GUARANTEED


@given(
    st.integers(-2, 2000),
    st.integers(0, CHANNELS - 1),
    st.integers(1, WINDOW - 1),
    st.integers(0, CHANNELS - 1),
)
def test_iterations_of_one_window_and_channels_never_share_a_tag(iteration, channel, later, other):
    assert tag(iteration, channel) != tag(iteration + later, other)
    assert tag(iteration, channel) == tag(iteration + WINDOW, channel)
    assert (tag(iteration, channel) == tag(iteration, other)) == (channel == other)


def test_negative_iterations_and_the_wrap():
    tags = [tag(iteration, Channel.CHARGE) for iteration in (-2, -1, 0, 508, 509)]
    assert len(set(tags)) == 5 and tag(510, 1) == tag(-2, 1) and tag(511, 1) == tag(-1, 1)


def test_channels_fit_and_far_rounds_have_their_own():
    assert max(Channel) < CHANNELS and len(set(map(int, Channel))) == len(Channel.__members__)
    assert Channel.PARTICLES.far is Channel.PARTICLES_FAR
    assert Channel.PARTICLES.wanted is Channel.PARTICLES_WANTED
