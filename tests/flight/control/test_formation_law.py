"""State feedback of the formation law."""

import jax.numpy as jnp
import numpy as np

from rpojax.flight.control import formation_law


def test_the_velocity_change_is_minus_the_gain_times_the_deviation() -> None:
    rng = np.random.default_rng(3)
    gain, deviation = rng.normal(size=(3, 6)), rng.normal(size=6)
    found = formation_law.lqr_feedback(jnp.asarray(gain), jnp.asarray(deviation))
    np.testing.assert_allclose(found, -gain @ deviation, rtol=1e-13)
