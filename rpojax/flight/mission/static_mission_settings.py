"""Static settings of a mission: number, order and kinds of its phases; changing one recompiles the simulation."""

from dataclasses import dataclass
from typing import Final, Literal

Pointing = Literal["target", "sun_safe", "velocity"]
TimeoutAction = Literal["next", "hold", "abort"]
Phasing = Literal["fixed", "spread", "viewpoints"]
"""Phases of relative orbits: those of the plan, spread anew when a servicer is left out, or for what is newly seen."""

BUILT_IN_PHASES: Final = ("hold", "aborted")
"""Phases of the mission manager itself, after those of the scenario: holding its place, and after an abort."""


@dataclass(frozen=True)
class PhaseSettings:
    """Static settings of a phase.

    Attributes:
        name: of the phase
        pointing: where the camera looks
        control_ticks: ticks between burn decisions
        burns_per_orbit: number of burns over an orbit that LQR gains are made for; 1 if it is so near to a circle that
            these are equal
        on_timeout: what follows a timeout
        ends: whether it has conditions that end it
        has_arrival_box: whether one of these is the arrival at the end of its reference
        passively_safe: whether no planned burn may make the free drift unsafe
        has_corridor: whether leaving its corridor is a reason for an abort
        stops_in_the_dark: whether it stops before the target gets dark, as its reference waits for it
        gain_tables: number of tables of gains, each for `burns_per_orbit` burns; the places of one table lie between
            those of another
        in_target_frame: whether reference, corridor and arrival box are in the frame of the target, which turns
        translates: whether thrusters of the reaction control system follow its reference all the time, without turns
    """

    name: str
    pointing: Pointing
    control_ticks: int
    burns_per_orbit: int
    on_timeout: TimeoutAction
    ends: bool
    has_arrival_box: bool
    passively_safe: bool
    has_corridor: bool
    stops_in_the_dark: bool
    gain_tables: int = 1
    translates: bool = False
    in_target_frame: bool = False


@dataclass(frozen=True)
class MissionSettings:
    """Static settings of a mission.

    Attributes:
        phases: in their order
        is_managed: whether phases end and aborts are decided; else there is one phase, without either
        decision_ticks: ticks between decisions of the mission manager
        hold_ticks: ticks between burn decisions while it holds its place or has aborted
        hold_burns_per_orbit: number of burns over an orbit then, as that of a phase
        hold_gain_tables: number of tables of gains then, as that of a phase
        coordinated: whether the servicer decides with others of a team
        servicers: number of those in the team
        keeps_clear: whether it keeps clear of their free motion
        phasing: how the phases of the relative orbits of a team are chosen
    """

    phases: tuple[PhaseSettings, ...]
    is_managed: bool
    decision_ticks: int
    hold_ticks: int
    hold_burns_per_orbit: int
    hold_gain_tables: int = 1
    coordinated: bool = False
    servicers: int = 1
    keeps_clear: bool = False
    phasing: Phasing = "fixed"

    @property
    def built_in(self) -> tuple[str, ...]:
        """Names of the rows after those of the phases."""
        return BUILT_IN_PHASES if self.is_managed else ()

    @property
    def translates(self) -> tuple[bool, ...]:
        """Whether a row uses the reaction control system; the built-in phases do where a phase does."""
        own = [phase.translates for phase in self.phases]
        return (*own, *(any(own) for _ in self.built_in))

    @property
    def in_target_frame(self) -> tuple[bool, ...]:
        """Whether a row has its reference in the frame of the target; the built-in phases have not."""
        return (*(phase.in_target_frame for phase in self.phases), *(False for _ in self.built_in))

    @property
    def before_target_frame(self) -> tuple[bool, ...]:
        """Whether a phase leads into the frame of the target."""
        turns = [phase.in_target_frame for phase in self.phases]
        return tuple(then and not now for now, then in zip(turns, [*turns[1:], False], strict=True))

    @property
    def ends_in_target_frame(self) -> bool:
        """Whether the last phase is in the frame of the target."""
        return self.phases[-1].in_target_frame

    @property
    def hold(self) -> int:
        """Row of the built-in phase that holds the present place."""
        return len(self.phases)

    @property
    def aborted(self) -> int:
        """Row of the built-in phase after an abort."""
        return len(self.phases) + 1

    @property
    def control_ticks(self) -> tuple[int, ...]:
        """Ticks between burn decisions by row, the built-in phases included."""
        return (*(phase.control_ticks for phase in self.phases), *(self.hold_ticks for _ in self.built_in))
