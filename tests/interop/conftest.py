"""A short flight with a burn, and its bags."""

import dataclasses

import jax
import numpy as np
import pytest
from folders import new_campaign

from rpojax.campaign.store import Campaign
from rpojax.interop import flight_record
from rpojax.interop.flight_record import Flight
from rpojax.simulation import scenario

SEED, RUN = 5, 3
SHORT = ("duration_s=180", "rates.formation_period_s=115")
"""Long enough for the second decision, the first with the target in sight, and its burn."""


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """A campaign folder in which no block is done."""
    file = scenario.load("inspection", SHORT)
    return new_campaign(tmp_path_factory.mktemp("interop") / "runs", file, SEED, 4, 0, 1)


@pytest.fixture(scope="session")
def flight(folder: Campaign) -> Flight:
    """One of its runs, with everything that messages say."""
    return flight_record.fly(folder, RUN)


@pytest.fixture(scope="session")
def around_burn(flight: Flight) -> Flight:
    """The part of it with the decision and the burn."""
    values, poses = jax.tree.map(lambda each: each[112:180:4], (flight.values, flight.poses))
    return dataclasses.replace(flight, values=values, poses=poses)


@pytest.fixture(scope="session")
def shots(around_burn: Flight) -> np.ndarray:
    """A picture of noise for every tick of that part; the camera of the flight takes none."""
    return np.random.default_rng(1).integers(0, 256, (around_burn.ticks, 6, 8, 3), dtype=np.uint8)
