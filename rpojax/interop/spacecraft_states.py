"""States of every spacecraft at every tick of a run, in double precision, for files of other tools."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Array

from rpojax.campaign import single_run
from rpojax.campaign.rerun import check_run_id
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.core.pytree import pytree, replace
from rpojax.errors import ScenarioError
from rpojax.flight.stages import Stages
from rpojax.interop.run_replay import ReplayedRun
from rpojax.physics.plant_state import Truth
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario
from rpojax.scenario.team.members import member_names
from rpojax.simulation.channels import LANDMARK_CHANNELS, ObservedTick
from rpojax.simulation.telemetry import Telemetry
from rpojax.time_scales import Instant, instant, utc_texts
from rpojax.version import __version__

TARGET = "target"
SERVICER = "servicer"
"""Name of a servicer that is no member of a team."""
TARGET_ESTIMATE = "target_estimate"


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
        q_TN_estimate: (4,) attitude of the target by flight software, NaN where it is not known, None without landmarks
    """

    r_TN_N: Array
    v_TN_N: Array
    r_ST_N: Array
    v_ST_N: Array
    q_TN: Array
    q_BN: Array
    q_TN_estimate: Array | None = None


def observe_tick(stages: Stages, scenario: Scenario, params: Params, telemetry: Telemetry) -> BothStates:
    """True states of both spacecraft at the beginning of a tick, and the estimated attitude of the target."""
    del stages
    states = _of_truth(telemetry.truth)
    if telemetry.flight.orbit.relative.target is None:
        return states
    estimate = LANDMARK_CHANNELS["q_TN_estimate"](ObservedTick(scenario, params, telemetry))
    return replace(states, q_TN_estimate=estimate)


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
class SpacecraftStates:
    """States of one spacecraft over time.

    Attributes:
        spacecraft: its name: `servicer`, that of a member of a team, or `target`; of an estimate that of its file
        epoch: start of the run
        time_s: (ticks,) since then [s]
        position_m: (ticks, 3) in N
        velocity_m_s: (ticks, 3) in N
        q: (ticks, 4) scalar first, from N to the body; of an estimate NaN where it is not known
        about: lines on where they come from
        estimated_of: name of the spacecraft whose attitude is estimated, empty for the truth
    """

    spacecraft: str
    epoch: Instant
    time_s: np.ndarray
    position_m: np.ndarray
    velocity_m_s: np.ndarray
    q: np.ndarray
    about: tuple[str, ...]
    estimated_of: str = ""

    @property
    def epochs(self) -> list[str]:
        """Time of each tick in UTC with 6, 9 or 12 decimals, as all need to be right to 50 ps."""
        return utc_texts([self.epoch.after(each) for each in self.time_s.tolist()])


def spacecraft_names(file: ScenarioFile) -> tuple[str, ...]:
    """Names of the servicers of a scenario, and `target`.

    Raises:
        ScenarioError: a servicer has the name of the target.
    """
    servicers = member_names(file) or (SERVICER,)
    if TARGET in servicers:
        raise ScenarioError("servicers.name", TARGET, "another name, for a file of each spacecraft")
    return (*servicers, TARGET)


def estimate_names(file: ScenarioFile) -> tuple[str, ...]:
    """Names of the estimated attitudes of the target, one of each servicer; none without landmarks.

    Raises:
        ScenarioError: a servicer has such a name.
    """
    if file.landmarks is None:
        return ()
    members = member_names(file)
    found = tuple(f"{name}_{TARGET_ESTIMATE}" for name in members) or (TARGET_ESTIMATE,)
    if taken := sorted(set(found) & set(members)):
        raise ScenarioError("servicers.name", taken[0], "another name, for a file of each estimate")
    return found


def initial_states(campaign: Campaign, run_id: int) -> list[SpacecraftStates]:
    """States of every servicer and of the target at the start of a run of a campaign, without simulating it.

    Raises:
        RpojaxError: there is no such run.
    """
    check_run_id(campaign, run_id)
    file, options = campaign.file.model_copy(update={"precision": "double"}), campaign.configuration.options
    arguments = (file, options.seed, run_id, options.design_range)
    if file.servicers:
        _, team, state = single_run.initialise_team_run(*arguments)
        truths = [jax.tree.map(lambda value, at=at: value[..., at], state.servicers.truth) for at in range(team.count)]
    else:
        truths = [single_run.initialise_run(*arguments)[2].truth]
    values = [jax.tree.map(lambda value: np.asarray(value)[None], _of_truth(truth)) for truth in truths]
    return _each(values, np.zeros(1), file, _about(campaign, run_id))


def replayed_states(runs: Sequence[ReplayedRun[BothStates]], campaign: Campaign) -> list[SpacecraftStates]:
    """States of every servicer and of the target of a replayed run of a campaign."""
    return _each([run.values for run in runs], runs[0].time_s, runs[0].file, _about(campaign, runs[0].run_id))


def estimated_attitudes(runs: Sequence[ReplayedRun[BothStates]], campaign: Campaign) -> list[SpacecraftStates]:
    """Attitude of the target by the flight software of each servicer, with its true orbit; none without landmarks."""
    target, found = replayed_states(runs, campaign)[-1], []
    for name, servicer, run in zip(estimate_names(campaign.file), spacecraft_names(campaign.file), runs, strict=False):
        about = (*target.about, f"Attitude of the target as the flight software of {servicer} estimates it")
        q = np.asarray(run.values.q_TN_estimate)
        found.append(dataclasses.replace(target, spacecraft=name, q=q, about=about, estimated_of=TARGET))
    return found


def _each(
    values: Sequence[BothStates], time_s: np.ndarray, file: ScenarioFile, about: tuple[str, ...]
) -> list[SpacecraftStates]:
    target = values[0]
    of_target = (np.asarray(target.r_TN_N), np.asarray(target.v_TN_N), np.asarray(target.q_TN))
    of_servicers = [(of_target[0] + own.r_ST_N, of_target[1] + own.v_ST_N, np.asarray(own.q_BN)) for own in values]
    epoch, names = instant(file.epoch_utc), spacecraft_names(file)
    return [
        SpacecraftStates(name, epoch, time_s, *states, about)
        for name, states in zip(names, [*of_servicers, of_target], strict=True)
    ]


def _about(campaign: Campaign, run_id: int) -> tuple[str, ...]:
    digest = campaign.configuration.scenario_hash[:16]
    name = "".join(letter if " " <= letter <= "~" else "?" for letter in campaign.file.name)[:60]
    return (
        f"Simulated by rpojax {__version__}: run {run_id} of seed {campaign.configuration.options.seed}",
        f"Scenario {name}, hash {digest}",
    )
