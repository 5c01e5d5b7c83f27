"""Phase table of a mission: the numbers of each phase, which can be dispersed or differentiated."""

from collections.abc import Sequence
from typing import Any, TypeVar

import jax.numpy as jnp
from jaxtyping import Array, Int

from rpojax.core.pytree import pytree, replace, select
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.flight.guidance.references.hold import Hold

T = TypeVar("T")


@pytree
class Until:
    """Conditions that end a phase when all of them hold; one that is not given always holds.

    Attributes:
        time: () since the phase began [s]
        arrival_box: (3,) half sides in H of the box around the end of the reference [m]
        arrival_for: () time in the box [s]
        range_sigma: () of the estimate [m]
        range_sigma_for: () time below it [s]
        ground_go: () time of the go from the ground since the start of the run [s]
    """

    time: Array
    arrival_box: Array
    arrival_for: Array
    range_sigma: Array
    range_sigma_for: Array
    ground_go: Array


@pytree
class Corridor:
    """Approach corridor: a cone that opens away from the target.

    Attributes:
        axis: (3,) direction from the target in H, of any length
        half_angle: () [rad]
        width: () radius of the corridor at the target [m]
    """

    axis: Array
    half_angle: Array
    width: Array


@pytree
class Phase:
    """Numbers of a phase.

    Attributes:
        reference: record of its reference trajectory, None for the formation's desired position
        position_weight: (3,) of the LQR, None for that of the formation [1/m^2]
        velocity_weight: (3,) of the LQR, None for that of the formation [s^2/m^2]
        delta_v_weight: (3,) of the LQR, None for that of the formation [s^2/m^2]
        until: conditions that end it
        timeout: () since the phase began [s]
        keep_out: (3,) semi-axes in H of the ellipsoid around the target that the servicer must not enter [m]
        corridor: that it must not leave, None without one
    """

    reference: Any
    position_weight: Array | None
    velocity_weight: Array | None
    delta_v_weight: Array | None
    until: Until
    timeout: Array
    keep_out: Array
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
        hold_at: () time of the command to hold [s]
        resume_at: () time of the command to resume [s]
        abort_at: () time of the command to abort [s]
        abort_horizon: () free drift that must stay outside of the keep-out zone [s]
        abort_sigmas: () uncertainty of the estimate that is covered, in sigmas [-]
        abort_margin: () added to the semi-axes of the keep-out zone [m]
    """

    phases: dict[str, Phase]
    keep_out: Array
    hold_at: Array
    resume_at: Array
    abort_at: Array
    abort_horizon: Array
    abort_sigmas: Array
    abort_margin: Array


def of_phase(phase: Int[Array, ""], rows: Sequence[T]) -> T:
    """The record or array of the present `phase` out of those of all rows."""
    chosen = rows[0]
    for number in range(1, len(rows)):
        chosen = select(phase == number, rows[number], chosen)
    return chosen


def constant_of_phase(phase: Int[Array, ""], values: Sequence[float] | Sequence[int] | Sequence[bool]) -> Array:
    """Static value of the present `phase` out of those of all rows."""
    return of_phase(phase, [jnp.asarray(value) for value in values])
