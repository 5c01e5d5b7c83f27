"""Schema of the phases of a mission, and of the mission's commands and aborts."""

from typing import Annotated, Final, Literal

from pydantic import Field

from rpojax.scenario.phases.reference_sections import ReferenceSection
from rpojax.value_types import (
    Angle,
    Direction,
    NonNegative,
    NonNegativeVector,
    OptionalKeys,
    Positive,
    PositiveVector,
    Section,
)

NO_GOAL: Final = "none"
"""Phase of a goal that demands nothing."""
PhaseName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]


class UntilSection(OptionalKeys):
    """Conditions that end a phase once all of those that are given hold."""

    time_s: Positive | None = None
    arrival_box_m: PositiveVector | None = None
    arrival_for_s: NonNegative | None = None
    range_sigma_m: Positive | None = None
    range_sigma_for_s: NonNegative | None = None
    ground_go_s: NonNegative | None = None


class CorridorSection(Section):
    """Approach corridor: a cone that opens away from the target along an axis in H."""

    axis: Direction
    half_angle_deg: Angle
    width_m: NonNegative


class PhaseSection(OptionalKeys):
    """One phase of a mission: what it follows, where it points, and when it ends."""

    name: PhaseName
    reference: ReferenceSection
    pointing: Literal["target", "sun_safe", "velocity"] = "target"
    control_period_s: Positive | None = None
    position_weight: NonNegativeVector | None = None
    velocity_weight: NonNegativeVector | None = None
    delta_v_weight: PositiveVector | None = None
    until: UntilSection | None = None
    timeout_s: Positive | None = None
    on_timeout: Literal["next", "hold", "abort"] = "hold"
    keep_out_m: PositiveVector | None = None
    corridor: CorridorSection | None = None
    passively_safe: bool = False


class GoalSection(OptionalKeys):
    """What a run must have reached by its end: the begin or the end of a phase, or nothing with `NO_GOAL`."""

    phase: PhaseName | None = None
    at: Literal["begin", "end"] | None = None


class MissionSection(Section):
    """Decisions of the mission manager, commands from the ground, and aborts."""

    decision_period_s: Positive = 20.0
    hold_at_s: NonNegative = 1e9
    resume_at_s: NonNegative = 1e9
    abort_at_s: NonNegative = 1e9
    abort_horizon_s: Positive = 86400.0
    abort_sigmas: NonNegative = 3.0
    abort_margin_m: NonNegative = 2.0
