"""Operations on pytrees."""

import jax.numpy as jnp
import numpy as np

from rpojax.core.pytree import concatenate, pytree


@pytree
class Pair:
    """Arrays of which one may be missing."""

    rows: object
    missing: object


def test_parts_are_joined_array_by_array_along_an_axis() -> None:
    parts = [
        {"a": Pair(rows=jnp.arange(4.0).reshape(2, 2) + number, missing=None), "b": np.full((1, 3), number)}
        for number in (0, 10)
    ]
    joined = concatenate(parts)
    assert isinstance(joined["a"].rows, np.ndarray)
    np.testing.assert_array_equal(joined["a"].rows, [[0, 1], [2, 3], [10, 11], [12, 13]])
    np.testing.assert_array_equal(joined["b"], [[0, 0, 0], [10, 10, 10]])
    assert joined["a"].missing is None
    np.testing.assert_array_equal(concatenate(parts, axis=-1)["a"].rows, [[0, 1, 10, 11], [2, 3, 12, 13]])
