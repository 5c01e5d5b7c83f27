"""What makes runs differ, for a linear covariance: every dispersion and random number, by name, with its sigma."""

from collections.abc import Mapping
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.stats import truncnorm

from rpojax.analysis import outlines
from rpojax.analysis.linear_state import Layout, Path
from rpojax.campaign import dispersions
from rpojax.core import quaternion
from rpojax.errors import RpojaxError
from rpojax.simulation import closed_loop, dispersed, schema
from rpojax.simulation import params as parameters
from rpojax.simulation.noise import StartNoise, TickNoise
from rpojax.simulation.params import Params
from rpojax.simulation.scenario import Scenario
from rpojax.simulation.schema import ScenarioFile

HANDOVER, GPS_BIAS, GYRO_BIAS = "hand-over estimate", "GPS bias", "gyro bias"
STAR_TRACKER, GYRO, GPS, BOX = "star tracker noise", "gyro noise", "GPS noise", "box edge noise"
OUTLINE, BURN, DECISION = "target outline", "burn execution", "burn decision"
_AT_START = ("initial", "orbit")
"""Sections whose numbers say where a run starts and nothing later."""
_POSITION, _VELOCITY = "initial.relative_position_m", "initial.relative_velocity_m_s"
_WIDEST_DEG = 10.0
"""An orbit's angle that is dispersed further turns everything, and the derivative of a turn is no turn."""


@dataclass(frozen=True)
class Dispersed:
    """Dispersed numbers as a mean and independent standard normal inputs.

    Attributes:
        mean: key -> value in the user's units
        columns: name of the source -> key -> (size, inputs) change per sigma of each input
        left_out: names of dispersions so wide that no derivative stands for them
    """

    mean: dict[str, np.ndarray]
    columns: dict[str, dict[str, np.ndarray]]
    left_out: list[str]

    def constants(self) -> tuple[Path, ...]:
        """Paths in `Params` of the numbers that keep their value all through a run and act on it."""
        return tuple(parameters.locate(key)[0] for key in self.mean if key.split(".")[0] not in _AT_START)


def disperse(file: ScenarioFile) -> Dispersed:
    """Mean and columns of all dispersions that small deviations make sense of; those of the tumble are left out.

    Raises:
        RpojaxError: a dispersion without mean and variance, or values that a table or grid gives.
    """
    if dispersed.tabled(file):
        raise RpojaxError(f"design.kind: found {file.design.kind!r}, expected draws from distributions")
    mean: dict[str, np.ndarray] = {}
    columns: dict[str, dict[str, np.ndarray]] = {}
    left_out: list[str] = []
    for entry in dispersed.in_order(file):
        name = dispersed.name(entry)
        if name in outlines.KEYS:
            continue
        match entry:
            case schema.CorrelatedNormal():
                columns[name] = _correlated(file, mean, entry)
            case schema.Derived():
                _derive(file, mean, columns, entry)
            case _:
                where = dispersed.place(entry.key)
                centre, change = _own(entry, np.asarray(dispersed.nominal(file, where), dtype=float))
                if where.key.startswith("orbit.") and where.key.endswith("_deg") and np.max(change) > _WIDEST_DEG:
                    left_out.append(name)
                    continue
                _enter(file, mean, where, centre)
                columns[name] = {where.key: _whole(file, where, change)}
    return Dispersed(mean, columns, left_out)


def _own(entry: schema.Dispersion, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (...) and columns (size, inputs) of a dispersion of one place."""
    size = nominal.size
    match entry:
        case schema.Normal():
            sigma = np.broadcast_to(np.asarray(entry.sigma, dtype=float), nominal.shape)
            return nominal, np.diag(sigma.reshape(-1))
        case schema.TruncatedNormal():
            cut = truncnorm.std(-entry.limit_sigmas, entry.limit_sigmas)
            sigma = cut * np.broadcast_to(np.asarray(entry.sigma, dtype=float), nominal.shape)
            return nominal, np.diag(sigma.reshape(-1))
        case schema.Uniform():
            middle = np.full_like(nominal, 0.5 * (entry.low + entry.high))
            return middle, (entry.high - entry.low) / np.sqrt(12.0) * np.eye(size)
        case schema.LogNormal():
            square = np.broadcast_to(np.asarray(entry.sigma, dtype=float) ** 2, nominal.shape)
            mean = np.asarray(nominal * np.exp(0.5 * square))
            return mean, np.diag((np.abs(mean) * np.sqrt(np.expm1(square))).reshape(-1))
        case schema.SmallRotation():
            sigma = np.broadcast_to(np.deg2rad(np.asarray(entry.sigma_deg, dtype=float)), (3,))

            def turned(angle: Array) -> Array:
                return quaternion.multiply(quaternion.exp(angle), quaternion.normalize(jnp.asarray(nominal)))

            return np.asarray(turned(jnp.zeros(3))), np.asarray(jax.jacfwd(turned)(jnp.zeros(3))) * sigma
        case _:
            raise RpojaxError(
                f"dispersions: found kind {entry.kind!r} for {dispersed.name(entry)!r}, "
                "expected one with small deviations from a mean"
            )


def _correlated(file: ScenarioFile, mean: dict[str, np.ndarray], entry: schema.CorrelatedNormal) -> dict:
    factor = dispersions.lower_factor(np.array(entry.covariance))
    change: dict[str, np.ndarray] = {}
    for row, where in zip(factor, dispersed.components(file, entry.keys), strict=True):
        _enter(file, mean, where, np.asarray(dispersed.nominal(file, where), dtype=float))
        whole = _whole(file, where, row[None, :])
        change[where.key] = change.get(where.key, 0.0) + whole
    return change


def _derive(
    file: ScenarioFile, mean: dict[str, np.ndarray], columns: dict[str, dict[str, np.ndarray]], entry: schema.Derived
) -> None:
    """What follows from other numbers changes with the sources of those."""
    where = dispersed.place(entry.key)
    shape = np.shape(dispersed.nominal(file, where))
    total = np.broadcast_to(np.asarray(entry.offset, dtype=float), shape)
    for term in entry.terms:
        other = dispersed.place(term.key)
        base = mean.get(other.key, np.asarray(dispersed.nominal(file, dispersed.place(other.key)), dtype=float))
        total = total + np.broadcast_to(term.factor * (base if other.index is None else base[other.index]), shape)
        for change in columns.values():
            if other.key in change:
                rows = change[other.key] if other.index is None else change[other.key][other.index][None, :]
                own = np.broadcast_to(term.factor * rows, (int(np.prod(shape)), rows.shape[1]))
                change[where.key] = change.get(where.key, 0.0) + _whole(file, where, own)
    _enter(file, mean, where, np.asarray(total))


def _enter(file: ScenarioFile, mean: dict[str, np.ndarray], where: dispersed.Place, value: np.ndarray) -> None:
    whole = mean.get(where.key, np.asarray(dispersed.nominal(file, dispersed.Place(where.key, None)), dtype=float))
    if where.index is None:
        whole = value
    else:
        whole = whole.copy()
        whole[where.index] = value
    mean[where.key] = whole


def _whole(file: ScenarioFile, where: dispersed.Place, change: np.ndarray) -> np.ndarray:
    """Columns of a whole key from those of a component of it."""
    if where.index is None:
        return change
    size = np.size(dispersed.nominal(file, dispersed.Place(where.key, None)))
    rows = np.zeros((size, change.shape[1]))
    rows[where.index] = change
    return rows


@dataclass(frozen=True)
class Start:
    """Where a nominal run begins, and what deviates there.

    Attributes:
        state: of the loop
        columns: name of the source -> (size, inputs) deviations of the vector per sigma
        mean: (size,) of the vector over all runs, less that of the nominal run
    """

    state: closed_loop.State
    columns: dict[str, np.ndarray]
    mean: np.ndarray


def starts(scenario: Scenario, params: Params, layout: Layout, key: Array, found: Dispersed) -> list[Start]:
    """Two nominal runs, one on either side of the mean; their covariances are averaged.

    They start one sigma beside the mean across the line of sight: what bearings tell of the range grows with the square
    of how far a run is off, so that the two learn as much as runs do in the mean, and their errors are turned as much
    out of the axes of H. Where no place is dispersed, the mean run is all there is.
    """
    names, widths = [*found.columns], [next(iter(each.values())).shape[1] for each in found.columns.values()]
    noise = {HANDOVER: 12, GPS_BIAS: 3, GYRO_BIAS: 3, STAR_TRACKER: 3, GYRO: 3}
    edges = np.cumsum([0, *widths, *noise.values()])
    parts = {name: slice(*edges[i : i + 2]) for i, name in enumerate([*names, *noise])}

    def begin(inputs: Array, centre: Mapping[str, Array]) -> tuple[Array, closed_loop.State]:
        values = dict(centre)
        for name in names:
            for key_of, change in found.columns[name].items():
                moved = jnp.sum(jnp.asarray(change) * inputs[parts[name]][None, :], axis=1)
                values[key_of] = values[key_of] + moved.reshape(values[key_of].shape)
        chosen = dispersions.apply(params, values)
        drawn = StartNoise(
            biases=jnp.concatenate([inputs[parts[GPS_BIAS]], inputs[parts[GYRO_BIAS]]]),
            box_edges=None,
            handover=inputs[parts[HANDOVER]],
            star_tracker=inputs[parts[STAR_TRACKER]],
            gyro=inputs[parts[GYRO]],
        )
        state = closed_loop.init(scenario, chosen, key, drawn)
        return layout.pack(state, chosen), state

    derive = jax.jit(lambda inputs, centre: (jax.jacfwd(begin, has_aux=True)(inputs, centre), begin(inputs, centre)[0]))
    zero = jnp.zeros(int(edges[-1]))
    mean = {key_of: jnp.asarray(value) for key_of, value in found.mean.items()}
    middle = np.asarray(derive(zero, mean)[1])
    until_s = scenario.formation_period_s + float(params.flight.formation.lead)
    rho_H = np.asarray(params.initial.relative_position)
    result = []
    for side in (1.0, -1.0) if {_POSITION, _VELOCITY} & {*mean} else (0.0,):
        off = {key_of: jnp.asarray(value) for key_of, value in _beside(found, rho_H, side, until_s).items()}
        (jacobian, state), vector = derive(zero, mean | off)
        columns = {name: np.asarray(jacobian)[:, part] for name, part in parts.items()}
        result.append(Start(state, columns, middle - np.asarray(vector)))
    return result


def _beside(found: Dispersed, rho_H: np.ndarray, side: float, until_s: float) -> dict[str, np.ndarray]:
    """Place and velocity off the mean across the line of sight along `rho_H`, on one `side` (1 or -1).

    Place and velocity are drawn apart, so that the distance grows as the root of the sum of their squares; a straight
    line from the start to `until_s` stands for that.
    """
    position, velocity = (_sigma(found, key) for key in (_POSITION, _VELOCITY))
    speed = (np.hypot(position, velocity * until_s) - position) / until_s
    line = rho_H / np.linalg.norm(rho_H)
    # The free motion takes place in the orbit plane and has a side of its own; across it there is none.
    sides = np.array([side, side, 1.0])
    off = {_POSITION: sides * position, _VELOCITY: sides * speed}
    return {key: found.mean[key] + each - line * (line @ each) for key, each in off.items() if key in found.mean}


def _sigma(found: Dispersed, key: str) -> np.ndarray:
    """(3,) standard deviations of a dispersed vector, zero if it is not."""
    changes = [each[key] for each in found.columns.values() if key in each]
    return np.sqrt(np.sum(np.concatenate([*changes, np.zeros((3, 1))], axis=1) ** 2, axis=1))


@dataclass(frozen=True)
class TickInputs:
    """Random numbers of a tick as one vector, edges of the box in pixels.

    Attributes:
        substeps: gyro samples in a tick
    """

    substeps: int

    @property
    def parts(self) -> dict[str, slice]:
        """Name of the source -> where its numbers stand."""
        widths = {GPS: 3, STAR_TRACKER: 3, GYRO: 3 * self.substeps, BOX: 4, GPS_BIAS: 3, GYRO_BIAS: 3}
        edges = np.cumsum([0, *widths.values()]).tolist()
        return {name: slice(*edges[i : i + 2]) for i, name in enumerate(widths)}

    @property
    def size(self) -> int:
        """Numbers in all."""
        return max(part.stop for part in self.parts.values())

    def sigma(self, edge_noise_px: float) -> np.ndarray:
        """(size,) standard deviations."""
        sigma = np.ones(self.size)
        sigma[self.parts[BOX]] = edge_noise_px
        return sigma

    def noise(self, vector: Array, nominal: TickNoise) -> TickNoise:
        """The numbers of a nominal tick with a vector added."""
        parts = self.parts
        box = jnp.concatenate([vector[parts[BOX]], jnp.zeros_like(nominal.box[4:])])
        return TickNoise(
            gps=nominal.gps + vector[parts[GPS]],
            star_tracker=nominal.star_tracker + vector[parts[STAR_TRACKER]],
            gyro=nominal.gyro + vector[parts[GYRO]].reshape(self.substeps, 3),
            box=nominal.box + box,
            chances=nominal.chances,
            burn=nominal.burn,
            chamber_pressure=nominal.chamber_pressure,
            biases=nominal.biases + jnp.concatenate([vector[parts[GPS_BIAS]], vector[parts[GYRO_BIAS]]]),
            box_edges=None,
        )


def still(substeps: int, box: Array, seen: Array) -> TickNoise:
    """A tick without noise, with the box's edges displaced by `box` (4,) [px], and without a box unless `seen`."""
    zero = jnp.zeros((), dtype=jnp.float64)
    return TickNoise(
        gps=jnp.zeros(3),
        star_tracker=jnp.zeros(3),
        gyro=jnp.zeros((substeps, 3)),
        box=jnp.concatenate([box, zero[None]]),
        # The first number is what a miss depends on, the second a false box.
        chances=jnp.ones(7).at[0].set(jnp.where(seen, 1.0, -1.0)),
        burn=jnp.zeros(4),
        chamber_pressure=zero,
        biases=jnp.zeros(6),
        box_edges=None,
    )


def names(found: Mapping[str, np.ndarray]) -> list[str]:
    """All sources, dispersions first."""
    own = (HANDOVER, GPS_BIAS, GYRO_BIAS, STAR_TRACKER, GYRO, GPS, BOX, OUTLINE, BURN, DECISION)
    return [*(name for name in found if name not in own), *own]
