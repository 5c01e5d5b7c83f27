"""The compilation cache can be replaced for a while."""

import jax
import jax.numpy as jnp
import pytest

from rpojax.runtime import jax_configuration


def test_temporary_cache_is_used_and_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jax, "clear_caches", lambda: None)  # programs of other tests stay in memory
    before: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    files = []
    with pytest.raises(ZeroDivisionError), jax_configuration.temporary_cache() as folder:
        jax.jit(lambda x: jnp.sin(x) + 1.25).lower(1.0).compile()
        files = list(folder.iterdir())
        raise ZeroDivisionError
    assert files
    assert not folder.exists()
    assert before == jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
