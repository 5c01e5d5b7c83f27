"""State of the mission manager between its decisions."""

import enum

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.flight.mission import abort_burn
from rpojax.flight.mission.abort_burn import AbortBurns
from rpojax.flight.mission.team_mission_state import TeamMission


class AbortReason(enum.IntEnum):
    """Reason of an abort; the first one that applies is recorded."""

    NONE = 0
    COMMAND = 1
    TIMEOUT = 2
    KEEP_OUT_PREDICTED = 3
    CORRIDOR_LEFT = 4
    TARGET_LOST = 5
    CONFIDENCE_LOST = 6
    THRUSTER_FAILED = 7
    ATTITUDE_LOST = 8

    @property
    def text(self) -> str:
        """The reason in words, empty without one."""
        words = {AbortReason.NONE: "", AbortReason.KEEP_OUT_PREDICTED: "keep-out zone ahead"}
        return words.get(self, self.name.lower().replace("_", " "))


class Transition(enum.IntEnum):
    """What began a phase: the start of the run, the end or the timeout of the one before, a command, or an abort."""

    START = 0
    CONDITIONS_MET = 1
    TIMEOUT = 2
    HOLD_COMMAND = 3
    RESUME_COMMAND = 4
    ABORT = 5

    @property
    def text(self) -> str:
        """It in words."""
        return self.name.lower().replace("_", " ")


class Condition(enum.IntFlag):
    """Conditions of `until`, as bits of those that do not hold."""

    TIME = 1
    ARRIVAL = 2
    RANGE_SIGMA = 4
    GROUND_GO = 8
    ATTITUDE_SIGMA = 16


@pytree
class MissionState:
    """State of the mission manager.

    Attributes:
        phase: () int32, row of the phase table; after these the built-in ones of holding and of an abort
        held_phase: () int32, phase to which a resumed mission returns
        entered_at: () when the phase began [s]
        entered_by: () int32, a `Transition`
        starts_at: () when its reference starts: at the middle of its first burn [s]
        entry: relative state in the frame of the phase, and orbit of the target then, predicted when the phase began
        arrived_at: () since when the servicer has been in the arrival box [s], infinite outside
        known_at: () since when the range has been known well enough [s], infinite if it is not
        attitude_known_at: () since when the attitude of the target has been [s], as `known_at`
        has_seen_target: () bool, whether the target was ever seen
        abort_reason: () int32, an `AbortReason`
        abort_burns: burns since an abort
        team: decisions because of other servicers, None unless a team is coordinated
    """

    phase: Array
    held_phase: Array
    entered_at: Array
    entered_by: Array
    starts_at: Array
    entry: PhaseEntry
    arrived_at: Array
    known_at: Array
    attitude_known_at: Array
    has_seen_target: Array
    abort_reason: Array
    abort_burns: AbortBurns
    team: TeamMission | None = None


def initial(entry: PhaseEntry, lead: Float[Array, ""], begins_at: Float[Array, ""] | None = None) -> MissionState:
    """State at the start of the first phase, whose entry is estimated for `lead` [s] later.

    It `begins_at` a time since the start of the run [s], by default with it.
    """
    zero = jnp.zeros_like(entry.relative_state[0])
    begin = zero if begins_at is None else zero + begins_at
    none = jnp.zeros((), dtype=jnp.int32)
    return MissionState(
        phase=none,
        held_phase=none,
        entered_at=begin,
        entered_by=none,
        starts_at=begin + lead,
        entry=entry,
        arrived_at=zero + jnp.inf,
        known_at=zero + jnp.inf,
        attitude_known_at=zero + jnp.inf,
        has_seen_target=jnp.zeros((), dtype=bool),
        abort_reason=none,
        abort_burns=abort_burn.none(),
    )
