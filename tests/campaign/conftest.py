"""Tests of this folder share compiled programs."""

import pytest


@pytest.fixture(scope="session", autouse=True)
def sharing(programs: None) -> None:
    """Engines for the same scenario use one pair of programs."""
