"""States of both spacecraft at every tick of a run, in double precision, for messages of other tools."""

import datetime
from dataclasses import dataclass
from typing import Literal

import jax
import numpy as np
from jaxtyping import Array

from rpojax.campaign import single_run
from rpojax.campaign.rerun import check_run_id
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.core.pytree import pytree
from rpojax.flight.stages import Stages
from rpojax.interop.run_replay import ReplayedRun
from rpojax.physics.plant_state import Truth
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.telemetry import Telemetry
from rpojax.version import __version__

SpacecraftName = Literal["servicer", "target"]
SPACECRAFT: tuple[SpacecraftName, ...] = ("servicer", "target")


@pytree
class BothStates:
    """States of both spacecraft at a tick, in N.

    Attributes:
        r_TN_N: (3,) position of the target [m]
        v_TN_N: (3,) velocity of the target [m/s]
        r_ST_N: (3,) position of the servicer from the target [m]
        v_ST_N: (3,) velocity of the servicer from the target [m/s]
        q_TN: (4,) attitude of the target
        q_BN: (4,) attitude of the servicer
    """

    r_TN_N: Array
    v_TN_N: Array
    r_ST_N: Array
    v_ST_N: Array
    q_TN: Array
    q_BN: Array


def observe_tick(stages: Stages, scenario: Scenario, params: Params, telemetry: Telemetry) -> BothStates:
    """States of both spacecraft at the beginning of a tick."""
    del stages, scenario, params
    return _of_truth(telemetry.truth)


def _of_truth(truth: Truth) -> BothStates:
    return BothStates(
        r_TN_N=truth.r_TN_N,
        v_TN_N=truth.v_TN_N,
        r_ST_N=truth.r_ST_N,
        v_ST_N=truth.v_ST_N,
        q_TN=truth.q_TN,
        q_BN=truth.q_BN,
    )


@dataclass(frozen=True)
class FlownStates:
    """States of one spacecraft over time.

    Attributes:
        spacecraft: which one
        epoch_utc: start of the run
        time_s: (ticks,) since then [s]
        position_m: (ticks, 3) in N
        velocity_m_s: (ticks, 3) in N
        q: (ticks, 4) scalar first, from N to the body
        about: lines on where they come from
    """

    spacecraft: SpacecraftName
    epoch_utc: datetime.datetime
    time_s: np.ndarray
    position_m: np.ndarray
    velocity_m_s: np.ndarray
    q: np.ndarray
    about: tuple[str, ...]

    @property
    def epochs(self) -> list[str]:
        """Time of each tick in UTC, to the microsecond."""
        moments = (self.epoch_utc + datetime.timedelta(microseconds=round(each * 1e6)) for each in self.time_s.tolist())
        return [moment.isoformat(timespec="microseconds") for moment in moments]


def initial_states(campaign: Campaign, run_id: int) -> list[FlownStates]:
    """States of servicer and target at the start of a run of a campaign, without simulating it.

    Raises:
        RpojaxError: there is no such run, or the scenario has a team.
    """
    check_run_id(campaign, run_id)
    file, options = campaign.file.model_copy(update={"precision": "double"}), campaign.configuration.options
    _, _, state = single_run.initialise_run(file, options.seed, run_id, options.design_range)
    values = jax.tree.map(lambda value: np.asarray(value)[None], _of_truth(state.truth))
    return _each(values, np.zeros(1), file, _about(campaign, run_id))


def flown_states(run: ReplayedRun[BothStates], campaign: Campaign) -> list[FlownStates]:
    """States of servicer and target of a replayed run of a campaign."""
    return _each(run.values, run.time_s, run.file, _about(campaign, run.run_id))


def _each(values: BothStates, time_s: np.ndarray, file: ScenarioFile, about: tuple[str, ...]) -> list[FlownStates]:
    epoch = utc_epoch(file)
    of_target = (np.asarray(values.r_TN_N), np.asarray(values.v_TN_N), np.asarray(values.q_TN))
    of_servicer = (of_target[0] + values.r_ST_N, of_target[1] + values.v_ST_N, np.asarray(values.q_BN))
    each = {"servicer": of_servicer, "target": of_target}
    return [FlownStates(name, epoch, time_s, *each[name], about) for name in SPACECRAFT]


def utc_epoch(file: ScenarioFile) -> datetime.datetime:
    """Start of the runs of a scenario in UTC."""
    moment = datetime.datetime.fromisoformat(file.epoch_utc)
    return moment if moment.tzinfo is None else moment.astimezone(datetime.UTC).replace(tzinfo=None)


def _about(campaign: Campaign, run_id: int) -> tuple[str, ...]:
    digest = campaign.configuration.scenario_hash[:16]
    name = "".join(letter if " " <= letter <= "~" else "?" for letter in campaign.file.name)[:60]
    return (
        f"Simulated by rpojax {__version__}: run {run_id} of seed {campaign.configuration.options.seed}",
        f"Scenario {name}, hash {digest}",
    )
