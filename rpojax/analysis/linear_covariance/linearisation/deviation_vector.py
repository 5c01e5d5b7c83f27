"""Deviation vector of a linear covariance: the numbers of the closed loop that deviate from the nominal run.

Left out are numbers without small deviations or first-order effect: the filters' covariances (their gains are those of
the nominal run), decisions and clocks of the flight software, and the target's attitude, which is dispersed over the
whole sphere and enters as an ensemble of outlines.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.flight.navigation.relative_filter_state import SLOW_STATES
from rpojax.scenario import params as parameters
from rpojax.scenario.params import Params
from rpojax.simulation.noise import TickNoise
from rpojax.simulation.state import State

Path = tuple[str, ...]

_STATES = (
    "truth.r_TN_N truth.v_TN_N truth.r_ST_N truth.v_ST_N truth.q_BN truth.omega_BN_B truth.wheel_speed truth.mass "
    "truth.delta_v sensor_errors.gps_bias_N sensor_errors.gyro_bias_B burn_error.magnitude burn_error.direction "
    "flight.orbit.servicer.r_SN_N flight.orbit.servicer.v_SN_N flight.orbit.servicer.gps_error_N "
    "flight.orbit.relative.r_TS_N flight.orbit.relative.v_TS_N "
    f"{' '.join(f'flight.orbit.relative.slow.{state.name}' for state in SLOW_STATES)} "
    "flight.attitude.q_BN flight.attitude.omega_BN_B flight.attitude.bias_B flight.attitude.gyro_B "
    "flight.pointing.reference.q_EN flight.pointing.reference.omega_EN_E flight.pointing.reference.remainder"
)
PENDING_BURN = "pending"
"""A decided burn that is still to come: deviation of its velocity change (3) and of its size (1)."""
HANDOVER, GPS_BIAS, GYRO_BIAS = "hand-over estimate", "GPS bias", "gyro bias"
STAR_TRACKER, GYRO, GPS, BOX = "star tracker noise", "gyro noise", "GPS noise", "box edge noise"
OUTLINE, BURN, DECISION = "target outline", "burn execution", "burn decision"


@dataclass(frozen=True)
class DeviationLayout:
    """Layout of the deviation vector: numbers of the state, dispersed constants, and the pending burn.

    Attributes:
        states: paths in `State`
        constants: paths in `Params` of dispersed numbers that are constant in a run
        slices: of each dotted path
        size: length of the vector
    """

    states: tuple[Path, ...]
    constants: tuple[Path, ...]
    slices: dict[str, slice]
    size: int

    def pack(self, state: State, params: Params) -> Array:
        """Vector (size,) of a state, without a pending burn."""
        records = [(state, path) for path in self.states] + [(params, path) for path in self.constants]
        leaves = [parameters.get_leaf(record, path) for record, path in records]
        return jnp.concatenate([jnp.ravel(leaf) for leaf in leaves] + [jnp.zeros(4, dtype=jnp.float64)])

    def unpack(self, vector: Array, state: State, params: Params) -> tuple[State, Params]:
        """State and parameters with the numbers of a vector."""
        for path in self.states:
            state = parameters.replace_leaf(state, path, self._leaf(vector, path, parameters.get_leaf(state, path)))
        for path in self.constants:
            params = parameters.replace_leaf(params, path, self._leaf(vector, path, parameters.get_leaf(params, path)))
        return state, params

    def _leaf(self, vector: Array, path: Path, like: Array) -> Array:
        return vector[self.slices[".".join(path)]].reshape(like.shape)

    def quaternion_signs(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Factors (size,), 1 or -1, by which the quaternions of `other` get the signs of the quaternions of `one`."""
        found = np.ones(self.size)
        for name, part in self.slices.items():
            if name.rpartition(".")[2].startswith("q_") and one[part] @ other[part] < 0.0:
                found[part] = -1.0
        return found

    def burn_jump(self) -> np.ndarray:
        """Map (size, size) over the middle of a burn: the pending velocity change enters truth and estimate."""
        jump = np.eye(self.size)
        pending = self.slices[PENDING_BURN]
        jump[pending, pending] = 0.0
        velocity = slice(pending.start, pending.start + 3)
        for name, sign in (
            ("truth.v_ST_N", 1.0),
            ("flight.orbit.servicer.v_SN_N", 1.0),
            ("flight.orbit.relative.v_TS_N", -1.0),
        ):
            jump[self.slices[name], velocity] = sign * np.eye(3)
        jump[self.slices["truth.delta_v"], pending.stop - 1] = 1.0
        return jump


def make_layout(state: State, params: Params, constants: tuple[Path, ...]) -> DeviationLayout:
    """Layout for a state of the loop and the paths of its dispersed constants."""
    states = tuple(tuple(text.split(".")) for text in _STATES.split())
    slices: dict[str, slice] = {}
    start = 0
    for root, paths in ((state, states), (params, constants)):
        for path in paths:
            stop = start + math.prod(parameters.get_leaf(root, path).shape)
            slices[".".join(path)] = slice(start, stop)
            start = stop
    slices[PENDING_BURN] = slice(start, start + 4)
    return DeviationLayout(states, constants, slices, start + 4)


def source_names(columns: Mapping[str, np.ndarray]) -> list[str]:
    """Names of all sources, those of dispersions among the initial `columns` first."""
    other = (HANDOVER, GPS_BIAS, GYRO_BIAS, STAR_TRACKER, GYRO, GPS, BOX, OUTLINE, BURN, DECISION)
    return [*(name for name in columns if name not in other), *other]


@dataclass(frozen=True)
class TickNoiseVector:
    """Layout of the random numbers of a tick in one vector; box edges are in pixels.

    Attributes:
        substeps: gyro samples in a tick
    """

    substeps: int

    @property
    def slices(self) -> dict[str, slice]:
        """Slice of each source by its name."""
        widths = {GPS: 3, STAR_TRACKER: 3, GYRO: 3 * self.substeps, BOX: 4, GPS_BIAS: 3, GYRO_BIAS: 3}
        edges = np.cumsum([0, *widths.values()]).tolist()
        return {name: slice(*edges[i : i + 2]) for i, name in enumerate(widths)}

    @property
    def size(self) -> int:
        """Length of the vector."""
        return max(part.stop for part in self.slices.values())

    def sigma(self, edge_noise_px: float) -> np.ndarray:
        """(size,) standard deviations."""
        sigma = np.ones(self.size)
        sigma[self.slices[BOX]] = edge_noise_px
        return sigma

    def unpack(self, vector: Array, nominal: TickNoise) -> TickNoise:
        """Noise of a nominal tick with the deviations of a vector (size,) added."""
        parts = self.slices
        box = jnp.concatenate([vector[parts[BOX]], jnp.zeros_like(nominal.camera[4:])])
        return TickNoise(
            gps=nominal.gps + vector[parts[GPS]],
            star_tracker=nominal.star_tracker + vector[parts[STAR_TRACKER]],
            gyro=nominal.gyro + vector[parts[GYRO]].reshape(self.substeps, 3),
            camera=nominal.camera + box,
            uniforms=nominal.uniforms,
            burn=nominal.burn,
            chamber_pressure=nominal.chamber_pressure,
            biases=nominal.biases + jnp.concatenate([vector[parts[GPS_BIAS]], vector[parts[GYRO_BIAS]]]),
            box_edge_errors=None,
        )


def zero_noise(substeps: int, edge_offset: Array, box_allowed: Array) -> TickNoise:
    """Zero noise of a tick, with the box displaced by `edge_offset` (4,) [px], and missed unless `box_allowed`."""
    zero = jnp.zeros((), dtype=jnp.float64)
    return TickNoise(
        gps=jnp.zeros(3),
        star_tracker=jnp.zeros(3),
        gyro=jnp.zeros((substeps, 3)),
        camera=jnp.concatenate([edge_offset, zero[None]]),
        # The first number is what a miss depends on, the second a false box.
        uniforms=jnp.ones(7).at[0].set(jnp.where(box_allowed, 1.0, -1.0)),
        burn=jnp.zeros(4),
        chamber_pressure=zero,
        biases=jnp.zeros(6),
        box_edge_errors=None,
    )
