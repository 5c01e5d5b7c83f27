"""Entry and exit distances of rays through a box, against worked cases."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.radiance_field.ray_box_intersection import ray_box_intersection


@pytest.mark.parametrize(
    ("origin", "direction", "distances"),
    [
        ([-3.0, 0.0, 0.0], [1.0, 0.0, 0.0], (2.0, 4.0)),
        ([0.0, 0.0, 0.0], [0.0, 0.6, 0.8], (0.0, 2.5)),
        ([-3.0, 2.5, 0.0], [1.0, 0.0, 0.0], None),
        ([3.0, 0.0, 0.0], [1.0, 0.0, 0.0], None),
    ],
    ids=["outside", "inside", "beside", "behind"],
)
def test_ray_enters_and_leaves_box(
    origin: list[float], direction: list[float], distances: tuple[float, float] | None
) -> None:
    low, high = jnp.array([-1.0, -2.0, -2.0], jnp.float32), jnp.array([1.0, 2.0, 2.0], jnp.float32)
    near, far = ray_box_intersection(low, high, jnp.asarray(origin, jnp.float32), jnp.asarray(direction, jnp.float32))
    if distances is None:
        assert float(near) == float(far)
    else:
        np.testing.assert_allclose([near, far], distances, rtol=1e-6)
