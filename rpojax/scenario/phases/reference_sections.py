"""Schema of the reference trajectories that a phase can follow; one strict model per kind."""

from typing import Annotated, Literal

from pydantic import Field

from rpojax.flight.guidance.references.approach import Approach
from rpojax.flight.guidance.references.arc import Arc
from rpojax.flight.guidance.references.fly_around import FlyAround
from rpojax.flight.guidance.references.hold import Hold
from rpojax.flight.guidance.references.relative_orbit import RelativeOrbit
from rpojax.flight.guidance.references.retreat import Retreat
from rpojax.flight.guidance.references.transfer import Transfer
from rpojax.scenario.numbers.number_sections import section_of


class HoldSection(section_of(Hold, first=("kind",))):
    """Fixed position in the frame of the phase."""

    kind: Literal["hold"]


class RelativeOrbitSection(section_of(RelativeOrbit, first=("kind",))):
    """Free relative orbit: safety ellipse, walking ellipse, or co-elliptic drift."""

    kind: Literal["relative_orbit"]


class TransferSection(section_of(Transfer, first=("kind",))):
    """Transfer to a position with two impulses or, with more, along a glide slope."""

    kind: Literal["transfer"]


class FlyAroundSection(section_of(FlyAround, first=("kind",), optional=True)):
    """Forced circle around the target."""

    kind: Literal["fly_around"]


class ApproachSection(section_of(Approach, first=("kind",))):
    """Straight line to a position with a speed that falls with the remaining distance."""

    kind: Literal["approach"]


class ArcSection(section_of(Arc, first=("kind",))):
    """Arc about the target to a position, which is then held."""

    kind: Literal["arc"]


class RetreatSection(section_of(Retreat, first=("kind",))):
    """Straight line away from the target."""

    kind: Literal["retreat"]


ReferenceSection = Annotated[
    HoldSection
    | RelativeOrbitSection
    | TransferSection
    | FlyAroundSection
    | ArcSection
    | ApproachSection
    | RetreatSection,
    Field(discriminator="kind"),
]
