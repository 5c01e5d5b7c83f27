"""Static settings of a team of servicers."""

from dataclasses import dataclass

from rpojax.flight.cooperation.link_settings import LinkSettings


@dataclass(frozen=True)
class TeamSettings:
    """Static settings of a team of servicers.

    Attributes:
        servicers: their number
        link: of the messages between them
        decision_offsets: camera ticks by which the burn decisions of each are later than at an offset of 0
        carrier_differences: whether differences of GPS positions are by carrier phase, not by code
        coordinated: whether the servicers tell each other their plans, and decide with these
    """

    servicers: int
    link: LinkSettings
    decision_offsets: tuple[int, ...]
    carrier_differences: bool
    coordinated: bool = False
