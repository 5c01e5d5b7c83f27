"""Where replaced stages of the flight software are used: one table over modes and stages.

A mode is a kind of scenario or a use of the closed loop. A mode that does not use a replaced stage, or only a part of
what it returns, refuses it: else a campaign would record a stage that changes nothing.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

from rpojax.core import named_arguments
from rpojax.errors import RpojaxError
from rpojax.flight.cooperation.team_settings import TeamSettings
from rpojax.flight.mission.static_mission_settings import MissionSettings
from rpojax.flight.stages import Stages


@dataclass(frozen=True)
class Mode:
    """A kind of scenario, or a use of the closed loop.

    Attributes:
        name: as errors and the documentation say it
        refused: reason by stage; stages that are not named are used
    """

    name: str
    refused: Mapping[str, str] = field(default_factory=dict, hash=False)


def _filters(reason: str) -> dict[str, str]:
    return dict.fromkeys(("orbit_update", "orbit_predict"), reason)


_NO_WINDOW: Final = {"detector_window": "which gives boxes of the whole frame"}
_JOINT: Final = "whose joint filter replaces what they return of the target"
_FIXED: Final = {"team_phasing": "where nobody chooses phases"}

WITHOUT_PHASES: Final = Mode(
    "a scenario without phases",
    dict.fromkeys(("reference", "mission_manager"), "where only `formation.desired_position_m` is kept"),
)
PHASES: Final = Mode("a mission of phases")
ARRIVAL: Final = Mode(
    "a phase with `until.arrival_box_m`", {"reference": "where arrival is judged by the end of the packaged reference"}
)
ALONE: Final = Mode("a scenario of one servicer", _FIXED)
FIXED_PHASES: Final = Mode('a team with `team.phasing = "fixed"`', _FIXED)
CHOSEN_PHASES: Final = Mode(
    "a team with another `team.phasing`", {"reference": "which chooses phases of the relative orbits of its file"}
)
SHARING: Final = {
    "none": Mode('a team with `navigation.sharing = "none"`'),
    "boxes": Mode("a team that shares `boxes`", _filters(_JOINT)),
    "estimates": Mode(
        "a team that shares `estimates`", _filters("whose filter of own boxes replaces what they return of the target")
    ),
    "central": Mode("a team that shares all boxes, `central`", _filters(_JOINT)),
    "naive": Mode("a team that fuses estimates, `naive`", {"own_memory": "which does not learn of what is fused"}),
}
"""By what a team shares."""
CAMERAS: Final = {
    "geometric": Mode("a `geometric` camera", _NO_WINDOW),
    "statistical": Mode("a `statistical` camera", _NO_WINDOW),
    "rendered": Mode("a `rendered` camera"),
}
"""By the model of the camera."""

RUNS: Final = Mode("runs and campaigns, and their `resume` and `rerun`")
REPLAYS: Final = Mode("exports and recordings that simulate a run again")
DERIVATIVES: Final = Mode("derivatives of runs (`gradient`, `sensitivity`, `tune`, `worst-case`)")
RARE_EVENTS: Final = Mode("rare events (`probability`)")
LINEAR_COVARIANCE: Final = Mode(
    "a linear covariance (`lincov`)", {"own_memory": "which carries the errors of the packaged filter's states alone"}
)
BENCH_LOOP: Final = Mode("a benchmark of the closed loop (`bench --only loop`)")
BENCH_KERNELS: Final = Mode(
    "a benchmark of kernels (`bench --only kernels`)", _filters("where the packaged orbit filter is measured")
)
LIVE: Final = Mode("a live run (`bridge`)")
EXTERNAL: Final = {
    "attitude": Mode(
        "a live run with `--external attitude`", {"wheel_torque": "where torques are those of another program"}
    ),
    "formation": Mode(
        "a live run with `--external formation`",
        dict.fromkeys(("formation_law", "reference"), "where burns are those of another program"),
    ),
    "navigation": Mode(
        "a live run with `--external navigation`",
        dict.fromkeys(("orbit_update", "own_memory"), "where the estimate is that of another program"),
    ),
}
"""By the part of the flight software that is left to another program."""

MODES: Final = (
    *(WITHOUT_PHASES, PHASES, ARRIVAL, ALONE, FIXED_PHASES, CHOSEN_PHASES, *SHARING.values(), *CAMERAS.values()),
    *(RUNS, REPLAYS, DERIVATIVES, RARE_EVENTS, LINEAR_COVARIANCE, BENCH_LOOP, BENCH_KERNELS, LIVE, *EXTERNAL.values()),
)
"""All modes, in the order of the documentation."""


def kinds_of(camera_model: str, mission: MissionSettings, team: TeamSettings | None) -> list[Mode]:
    """Modes that a scenario is of, by the model of its camera, the phases of its mission and its team."""
    kinds = [CAMERAS[camera_model], PHASES if mission.is_managed else WITHOUT_PHASES]
    if any(phase.has_arrival_box for phase in mission.phases):
        kinds.append(ARRIVAL)
    if team is None:
        return [*kinds, ALONE]
    return [*kinds, SHARING[team.link.sharing], FIXED_PHASES if mission.phasing == "fixed" else CHOSEN_PHASES]


def check_picture(stages: Stages, camera_model: str) -> None:
    """Refuses an update of the filter that asks for a picture where the camera gives none.

    Raises:
        RpojaxError: naming the stage and the camera.
    """
    if stages.takes_picture and camera_model != "rendered":
        expected = f'one without it, for `camera.model = "{camera_model}"` gives none'
        raise RpojaxError(f"stages.orbit_update: found one with the argument `picture`, expected {expected}")


def check_believed(stages: Stages, sensors: Iterable[str]) -> None:
    """Refuses a replaced update of the filter that leaves out additional sensors which it is to believe.

    Raises:
        RpojaxError: naming the stage and the sensor.
    """
    for name in sensors:
        if "orbit_update" in stages.replaced and not named_arguments.takes(stages.orbit_update, "sensors"):
            expected = f"one that takes `sensors`, for the filter is to believe [{name}]"
            raise RpojaxError(f"stages.orbit_update: found one without the argument `sensors`, expected {expected}")


def check_exposures(stages: Stages, memory_ticks: int) -> None:
    """Refuses a replaced update of the filter that takes late measurements for those of now, where they are not to be.

    Raises:
        RpojaxError: naming the stage.
    """
    if (
        memory_ticks
        and "orbit_update" in stages.replaced
        and not named_arguments.takes(stages.orbit_update, "exposures")
    ):
        expected = "one that takes `exposures`, for measurements are late, or navigation.delays = 'ignored'"
        raise RpojaxError(f"stages.orbit_update: found one without the argument `exposures`, expected {expected}")


def check(stages: Stages, modes: Iterable[Mode]) -> None:
    """Refuses replaced stages that one of the modes does not use, or only in part.

    Raises:
        RpojaxError: naming stage and mode.
    """
    for mode in modes:
        for stage in stages.replaced:
            if reason := mode.refused.get(stage):
                expected = f"the packaged one in {mode.name}, {reason}"
                raise RpojaxError(f"stages.{stage}: found one of your own, expected {expected}")
