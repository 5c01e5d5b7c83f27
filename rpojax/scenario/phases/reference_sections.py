"""Schema of the reference trajectories that a phase can follow; one strict model per kind."""

from typing import Annotated, Literal

from pydantic import Field

from rpojax.value_types import Direction, Finite, NonNegative, OptionalKeys, Positive, Section, Vector


class HoldSection(Section):
    """Fixed position in H."""

    kind: Literal["hold"]
    position_m: Vector


class RelativeOrbitSection(Section):
    """Free relative orbit: safety ellipse, walking ellipse, or co-elliptic drift."""

    kind: Literal["relative_orbit"]
    radial_m: NonNegative = 0.0
    radial_phase_deg: Finite = 0.0
    cross_track_m: NonNegative = 0.0
    cross_track_phase_deg: Finite = 0.0
    along_track_m: Finite = 0.0
    drift_per_orbit_m: Finite = 0.0
    join_s: NonNegative = 0.0


class TransferSection(Section):
    """Transfer to a position with two impulses or, with more, along a glide slope."""

    kind: Literal["transfer"]
    position_m: Vector
    duration_s: Positive
    pulses: Annotated[int, Field(ge=2, le=64)] = 2
    speed_ratio: Annotated[float, Field(gt=0.0, le=1.0, allow_inf_nan=False)] = 1.0


class FlyAroundSection(OptionalKeys):
    """Forced circle around the target."""

    kind: Literal["fly_around"]
    radius_m: Positive
    axis: Direction
    rate_deg_h: Finite
    join_s: NonNegative = 0.0
    start_deg: Finite | None = None


class ApproachSection(Section):
    """Straight line to a position with a speed that falls with the remaining distance."""

    kind: Literal["approach"]
    end_position_m: Vector
    max_speed_m_s: Positive
    time_constant_s: Positive
    final_speed_m_s: Positive


class RetreatSection(Section):
    """Straight line away from the target."""

    kind: Literal["retreat"]
    distance_m: Positive
    speed_m_s: Positive


ReferenceSection = Annotated[
    HoldSection | RelativeOrbitSection | TransferSection | FlyAroundSection | ApproachSection | RetreatSection,
    Field(discriminator="kind"),
]
