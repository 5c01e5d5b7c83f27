"""Losses of radio links: their frequencies, bursts and outages."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.physics import radio_link
from rpojax.physics.radio_link import RadioLink


def link(**changes: object) -> RadioLink:
    values = {
        "loss": 0.2,
        "burst_loss": 1.0,
        "burst_interval": 50.0,
        "burst_duration": 10.0,
        "outage_start": [100.0, 500.0],
        "outage_end": [200.0, 600.0],
    }
    return RadioLink(**{name: jnp.asarray(value) for name, value in {**values, **changes}.items()})


def test_bursts_have_their_duration_and_share_of_time() -> None:
    uniforms = jax.random.uniform(jax.random.key(0), (20_000, 3, 3))

    def body(state: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array]:
        state = radio_link.advance_bursts(link(), state, u, 1.0)
        return state, state

    bursts = np.asarray(jax.lax.scan(body, jnp.zeros((3, 3), dtype=bool), uniforms)[1])
    begins, ends = 1 - np.exp(-0.02), 1 - np.exp(-0.1)
    assert bursts.mean() == pytest.approx(begins / (begins + ends), rel=0.05)
    starts = (bursts[1:] & ~bursts[:-1]).sum()
    assert bursts.sum() / starts == pytest.approx(1 / ends, rel=0.05)


def test_losses_are_more_frequent_in_bursts() -> None:
    uniforms = jax.random.uniform(jax.random.key(1), (200, 200))
    for in_burst, expected in ((False, 0.2), (True, 0.7)):
        arrived = radio_link.arrives(link(burst_loss=0.7), jnp.full((200, 200), in_burst), uniforms, jnp.asarray(0.0))
        assert 1.0 - np.asarray(arrived).mean() == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(
    ("time", "is_up"), [(99.0, True), (100.0, False), (199.0, False), (200.0, True), (550.0, False)]
)
def test_nothing_arrives_in_an_outage(time: float, is_up: bool) -> None:
    ones = jnp.ones((2, 2))
    assert (np.asarray(radio_link.arrives(link(), ones < 0, 0.999 * ones, jnp.asarray(time))) == is_up).all()
