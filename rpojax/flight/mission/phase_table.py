"""Phase table of a mission: the numbers of each phase, which can be dispersed or differentiated."""

from collections.abc import Sequence
from typing import Any, TypeVar

import jax.numpy as jnp
from jaxtyping import Array, Int

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree, replace, select
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.flight.guidance.references.hold import Hold
from rpojax.value_types import Direction

T = TypeVar("T")


@pytree
class Until:
    """Conditions that end a phase when all of them hold; one that is not given always holds."""

    time: Array = number("time since the phase began", unit="s", above=0.0, default=None)
    arrival_box: Array = number(
        "half sides of a box around the end of the reference, in the axes of its frame",
        unit="m",
        length=3,
        above=0.0,
        default=None,
    )
    arrival_for: Array = number("time in that box", unit="s", at_least=0.0, default=None)
    range_sigma: Array = number("standard deviation of the estimated range", unit="m", above=0.0, default=None)
    range_sigma_for: Array = number("time below it", unit="s", at_least=0.0, default=None)
    attitude_sigma: Array = number(
        "standard deviation of the estimated attitude of the target about the least known axis of T; before a phase in "
        "the frame of the target it also has to turn so slowly that the thrusters can follow",
        unit="deg",
        above=0.0,
        default=None,
    )
    attitude_sigma_for: Array = number("time below it", unit="s", at_least=0.0, default=None)
    ground_go: Array = number("time of the go from the ground since the start", unit="s", at_least=0.0, default=None)


@pytree
class Corridor:
    """Approach corridor: a cone that opens away from the target."""

    axis: Array = number("direction from the target, in the axes of the phase's frame; any length", form=Direction)
    half_angle: Array = number("half angle of the cone", unit="deg", above=0.0, below=180.0)
    width: Array = number("radius of the corridor at the target", unit="m", at_least=0.0)


@pytree
class Phase:
    """Numbers of a phase.

    Attributes:
        reference: record of its reference trajectory, None for the formation's desired position
        until: conditions that end it
        corridor: that it must not leave, None without one
    """

    reference: Any
    position_weight: Array | None = number(
        "LQR weight of the squared position deviation, by default as in `formation`",
        length=3,
        at_least=0.0,
        default=None,
    )
    velocity_weight: Array | None = number(
        "LQR weight of the squared velocity deviation, by default as in `formation`",
        length=3,
        at_least=0.0,
        default=None,
    )
    delta_v_weight: Array | None = number(
        "LQR weight of the squared velocity change, by default as in `formation`", length=3, above=0.0, default=None
    )
    until: Until
    timeout: Array = number(
        "longest duration, not less than `until.time_s`, `arrival_for_s` and `range_sigma_for_s`; by default none",
        unit="s",
        above=0.0,
        default=None,
    )
    keep_out: Array = number(
        "semi-axes in H of the keep-out ellipsoid, none less than `limits.keep_out_m`, which is the default",
        unit="m",
        length=3,
        above=0.0,
        default=None,
    )
    corridor: Corridor | None

    def trajectory(self, formation: FormationTuning) -> Any:
        """Record of its reference trajectory."""
        return Hold(position=formation.desired_position) if self.reference is None else self.reference

    def weights(self, formation: FormationTuning) -> FormationTuning:
        """Tuning of its control law: that of the formation, but for weights of its own."""
        names = ("position_weight", "velocity_weight", "delta_v_weight")
        own = {name: getattr(self, name) for name in names}
        return replace(formation, **{name: value for name, value in own.items() if value is not None})


@pytree
class MissionTuning:
    """Phases of a mission, commands from the ground, and the limits of free drifts.

    Attributes:
        phases: by name
        keep_out: (3,) semi-axes of the keep-out ellipsoid while the servicer holds its place or has aborted [m]
    """

    phases: dict[str, Phase]
    keep_out: Array
    hold_at: Array = number(
        "time of the command to hold the present place, by default never", unit="s", at_least=0.0, default=1e9
    )
    resume_at: Array = number(
        "time of the command to resume the phase that was held, by default never", unit="s", at_least=0.0, default=1e9
    )
    abort_at: Array = number("time of the command to abort, by default never", unit="s", at_least=0.0, default=1e9)
    abort_horizon: Array = number(
        "free drift that must stay outside of the keep-out zone, by default a day", unit="s", above=0.0, default=86400.0
    )
    abort_sigmas: Array = number("uncertainty of the estimate that is covered, in sigmas", at_least=0.0, default=3.0)
    abort_margin: Array = number("added to the semi-axes of the keep-out zone", unit="m", at_least=0.0, default=2.0)


def of_phase(phase: Int[Array, ""], rows: Sequence[T]) -> T:
    """The record or array of the present `phase` out of those of all rows."""
    chosen = rows[0]
    for index in range(1, len(rows)):
        chosen = select(phase == index, rows[index], chosen)
    return chosen


def constant_of_phase(phase: Int[Array, ""], values: Sequence[float] | Sequence[int] | Sequence[bool]) -> Array:
    """Static value of the present `phase` out of those of all rows."""
    return of_phase(phase, [jnp.asarray(value) for value in values])
