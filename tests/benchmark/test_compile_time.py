"""Compilation caches of a benchmark."""

import jax
import jax.numpy as jnp
import pytest

from rpojax.benchmark import compile_time


def test_temporary_cache_is_used_and_removed(keep_compiled: None) -> None:
    before: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    files = []
    with pytest.raises(ZeroDivisionError), compile_time.temporary_cache() as folder:
        jax.jit(lambda x: jnp.sin(x) + 1.25).lower(1.0).compile()
        files = list(folder.iterdir())
        raise ZeroDivisionError
    assert files
    assert not folder.exists()
    assert before == jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
