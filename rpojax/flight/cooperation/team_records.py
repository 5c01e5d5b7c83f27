"""Records of a team: what each servicer brings to the exchange of messages, with the servicers along the last axis."""

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Shaped

from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.pytree import pytree, replace
from rpojax.flight.navigation.box_measurement.outlier_gate import GateState
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement

T = TypeVar("T")


@pytree
class TeamRecords:
    """Servicers of a team after navigation of a tick; all arrays have a last axis of servicers.

    Attributes:
        orbit: estimates after each servicer's own update
        gate: states of the outlier gates
        accepted: (N,) bool, boxes that passed the gates in these updates; none at hand-over
        box: boxes as the orbit filters got them
        gps: positions, by code or carrier phase, whose differences are the baselines
        q_KN: (4, N) attitudes of the cameras by the attitude filters
        running: (N,) bool, a servicer that failed neither sends nor hears
        ranges: (peers, N) that each measures to its peers over the links [m], None if ranges are not
            measured
        rows: of the additional sensors that the filters believe, as of a state of zero, None without such
            sensors
    """

    orbit: OrbitEstimate
    gate: GateState
    accepted: Array
    box: BoxMeasurement
    gps: GpsMeasurement
    q_KN: Array
    running: Array
    ranges: Array | None = None
    rows: MeasurementRows | None = None

    @property
    def gated_box(self) -> BoxMeasurement:
        """The boxes as far as they passed the gates; a frame with a false one tells nothing."""
        expected = self.box.expected & (self.accepted | ~self.box.present)
        return replace(self.box, present=self.accepted, expected=expected)


def of_pairs(matrix: Shaped[Array, "N N"], peers: tuple[tuple[int, ...], ...]) -> Shaped[Array, "peers N"]:
    """Values (receiver, sender) as those of the peers of each receiver."""
    return jnp.stack([jnp.stack([matrix[i, j] for j in row]) for i, row in enumerate(peers)], axis=-1)


def for_receivers(of_servicers: T, peers: tuple[tuple[int, ...], ...]) -> T:
    """Arrays (..., N) of servicers as (peers, ..., N): what each of N receivers gets from its peers."""

    def gather(leaf: Array) -> Array:
        return jnp.stack([jnp.stack([leaf[..., j] for j in row]) for row in peers], axis=-1)

    return jax.tree.map(gather, of_servicers)
