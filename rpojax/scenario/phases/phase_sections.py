"""Schema of the phases of a mission, and of the mission's commands and aborts."""

from typing import Annotated, Final, Literal

from pydantic import Field

from rpojax.flight.mission.mission_state import Condition
from rpojax.flight.mission.phase_table import Corridor, MissionTuning, Phase, Until
from rpojax.scenario.numbers.number_sections import section_of
from rpojax.scenario.phases.reference_sections import ReferenceSection
from rpojax.value_types import OptionalKeys, Positive

NO_GOAL: Final = "none"
"""Phase of a goal that demands nothing."""
PhaseName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]


class UntilSection(section_of(Until, optional=True)):
    """Conditions that end a phase once all of those that are given hold."""


CONDITION_KEYS: Final = {
    Condition.TIME: "time_s",
    Condition.ARRIVAL: "arrival_box_m",
    Condition.RANGE_SIGMA: "range_sigma_m",
    Condition.GROUND_GO: "ground_go_s",
    Condition.ATTITUDE_SIGMA: "attitude_sigma_deg",
}
"""Key of `until` of each condition."""
LASTING_KEYS: Final = {
    "arrival_for_s": "arrival_box_m",
    "range_sigma_for_s": "range_sigma_m",
    "attitude_sigma_for_s": "attitude_sigma_deg",
}
"""Keys of the times for which conditions hold, and those of the conditions."""


class CorridorSection(section_of(Corridor)):
    """Approach corridor: a cone that opens away from the target along an axis in the phase's frame."""


_FIRST = (
    "name", "reference", "frame", "pointing", "control", "position_", "velocity_", "delta_v_", "until", "timeout",
)  # fmt: skip


class PhaseSection(section_of(Phase, first=(*_FIRST, "on_timeout", "keep_out_m"), optional=True)):
    """One phase of a mission: what it follows, where it points, and when it ends."""

    name: PhaseName
    reference: ReferenceSection
    frame: Literal["hill", "target"] = "hill"
    pointing: Literal["target", "sun_safe", "velocity"] = "target"
    control: Literal["burns", "continuous"] = "burns"
    control_period_s: Positive | None = None
    until: UntilSection | None = None
    on_timeout: Literal["next", "hold", "abort"] = "hold"
    corridor: CorridorSection | None = None
    passively_safe: bool = False


class GoalSection(OptionalKeys):
    """What a run must have reached by its end: the begin or the end of a phase, or nothing with `NO_GOAL`."""

    phase: PhaseName | None = None
    at: Literal["begin", "end"] | None = None


class MissionSection(section_of(MissionTuning, first=("decision_period_s",))):
    """Decisions of the mission manager, commands from the ground, and aborts."""

    decision_period_s: Positive = 20.0
