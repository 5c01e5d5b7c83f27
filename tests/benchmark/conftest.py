"""Tests of this folder share compiled programs and keep them in memory."""

import jax
import pytest


@pytest.fixture(scope="session", autouse=True)
def sharing(programs: None) -> None:
    """Engines for the same scenario use one pair of programs."""


@pytest.fixture
def keep_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """A benchmark does not drop what other tests have compiled."""
    monkeypatch.setattr(jax, "clear_caches", lambda: None)
