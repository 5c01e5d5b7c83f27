"""Functions whose devices share the rows of a batch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from rpojax.runtime.device_mesh import DeviceMesh, gather_rows, own_rows, padded_batches


def test_each_device_computes_its_rows_and_sees_those_of_all() -> None:
    mesh = DeviceMesh(jax.devices())
    rows = np.arange(6.0 * mesh.size).reshape(3 * mesh.size, 2)

    def share_of_total(factor: Array, own: Array) -> tuple[Array, Array]:
        assert own.shape == (3, 2)
        everything = gather_rows(own)
        return factor * own / jnp.sum(everything), own_rows(everything)

    scaled, same = jax.jit(mesh.by_rows(share_of_total, whole=1))(2.0, mesh.place(rows))
    np.testing.assert_allclose(scaled, 2.0 * rows / rows.sum(), rtol=1e-15)
    np.testing.assert_array_equal(same, rows)
    assert mesh.size == len(scaled.sharding.device_set) == jax.device_count()


@pytest.mark.parametrize("count", [1, 4, 5, 8])
def test_batches_hold_each_row_once_and_are_padded_with_the_last(count: int) -> None:
    batches = list(padded_batches(count, 4))
    assert all(rows.shape == counted.shape == (4,) for rows, counted in batches)
    np.testing.assert_array_equal(np.concatenate([rows[counted] for rows, counted in batches]), np.arange(count))
    rows, counted = batches[-1]
    assert (rows[~counted] == count - 1).all()
