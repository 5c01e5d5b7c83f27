"""Ensemble of tumbling targets that represents all attitudes and tumbles, and their outlines along one view."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from rpojax.core import quaternion, random_streams
from rpojax.core.numerics import runge_kutta
from rpojax.core.pytree import pytree, replace
from rpojax.flight.navigation import outline_correlation
from rpojax.flight.navigation.outline_correlation import OutlineCorrelation
from rpojax.physics import rigid_body
from rpojax.physics.environment.gravity_gradient_torque import gravity_gradient_torque
from rpojax.physics.plant_state import Truth
from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import camera_pose
from rpojax.vision import bounding_box, box_projection

KEYS = ("target.attitude", "target.tumble_axis", "target.tumble_rate_deg_s")
"""Keys whose dispersion is represented by the ensemble, not by a derivative."""
_MIN_SIDE_PX = 0.1


@pytree
class TargetEnsemble:
    """Attitudes and angular velocities of the targets.

    Attributes:
        q_TN: (members, 4)
        omega_TN_T: (members, 3) [rad/s]
        outline: (members) what the filter would know of the correlation of each one's outline
    """

    q_TN: Array
    omega_TN_T: Array
    outline: OutlineCorrelation


@pytree
class EnsembleOutlines:
    """Boxes around the targets in one frame, averaged in centre and in logarithm of the sides.

    Attributes:
        mean: (4,) edges with the mean centre and the mean logarithms [px]
        deviations: (members, 4) of the edges from these, to first order [px]
        log_aspects: (members,) logs of width over height
    """

    mean: Array
    deviations: Array
    log_aspects: Array


@pytree
class RelativeBox:
    """A box relative to another one.

    Attributes:
        offset: (2,) between the centres [px]
        ratio: (2,) of width and height
    """

    offset: Array
    ratio: Array


def relative_box(reference: Float[Array, "4"], box: Float[Array, "4"]) -> RelativeBox:
    """A box (edges [px]) relative to a reference box."""
    sides = jnp.maximum(reference[2:] - reference[:2], _MIN_SIDE_PX)
    return RelativeBox(
        offset=bounding_box.box_center(box) - bounding_box.box_center(reference), ratio=(box[2:] - box[:2]) / sides
    )


def apply_relative_box(reference: Float[Array, "4"], relative: RelativeBox) -> Float[Array, "4"]:
    """Edges [px] of a box given relative to a reference box."""
    center = bounding_box.box_center(reference) + relative.offset
    half = 0.5 * relative.ratio * (reference[2:] - reference[:2])
    return jnp.concatenate([center - half, center + half])


def initial_ensemble(file: ScenarioFile, params: Params, members: int) -> TargetEnsemble:
    """Quasi-random attitudes, tumble axes and rates from their dispersions; a single target without dispersions."""
    entries = [entry for entry in file.dispersions if entry.name in KEYS]
    kept = file.model_copy(update={"dispersions": entries})
    count = members if entries else 1
    coordinates = [dispersion_keys.coordinate_count(file, entry) for entry in entries]
    unit = np.clip(qmc.Sobol(max(sum(coordinates), 1), scramble=True, rng=0).random(count), 1e-12, 1.0 - 1e-12)
    columns = np.split(unit[:, : sum(coordinates)], np.cumsum(coordinates)[:-1], axis=1) if entries else []
    cube = {entry.name: jnp.asarray(part) for entry, part in zip(entries, columns, strict=True)}

    def target_at(cube: dict[str, Array], _: Array) -> TargetEnsemble:
        values = dispersed_values.draw(kept, random_streams.master_key(0), cube)
        target = dispersed_values.apply_to_params(params, values).plant.target
        return TargetEnsemble(
            q_TN=quaternion.normalize(target.attitude),
            omega_TN_T=target.tumble_rate * quaternion.normalize(target.tumble_axis),
            outline=outline_correlation.initial(),
        )

    return jax.vmap(target_at)(cube, jnp.zeros(count))


def propagate_ensemble(scenario: Scenario, params: Params, ensemble: TargetEnsemble, r_TN_N: Array) -> TargetEnsemble:
    """Attitudes one tick later, at position `r_TN_N` [m]; torques of drag and radiation are neglected."""
    inertia = params.plant.target.inertia
    inverse = rigid_body.inverse_3x3(inertia)

    def derivative(y: tuple[Array, Array], _: Array) -> tuple[Array, Array]:
        q_TN, omega_TN_T = y
        torque = jnp.zeros(3)
        if scenario.effects.gravity_gradient:
            r_T = quaternion.rotate(q_TN, r_TN_N)
            torque = gravity_gradient_torque(r_T, inertia, params.plant.gravity.mu)
        return (
            quaternion.derivative(q_TN, omega_TN_T),
            rigid_body.angular_acceleration(inertia, inverse, omega_TN_T, torque),
        )

    def propagate(q_TN: Array, omega_TN_T: Array) -> tuple[Array, Array]:
        q_TN, omega_TN_T = runge_kutta.rk4(derivative, (q_TN, omega_TN_T), jnp.zeros(3), scenario.tick_s)
        return quaternion.normalize(q_TN), omega_TN_T

    q_TN, omega_TN_T = jax.vmap(propagate)(ensemble.q_TN, ensemble.omega_TN_T)
    return replace(ensemble, q_TN=q_TN, omega_TN_T=omega_TN_T)


def ensemble_outlines(scenario: Scenario, params: Params, ensemble: TargetEnsemble, truth: Truth) -> EnsembleOutlines:
    """Outlines of the targets at the true target's position, through the true camera."""

    def center_and_log_sides(q_TN: Float[Array, "4"]) -> Array:
        edges = target_outline(scenario, params, q_TN, truth)
        sides = jnp.maximum(edges[2:] - edges[:2], _MIN_SIDE_PX)
        return jnp.concatenate([bounding_box.box_center(edges), jnp.log(sides)])

    boxes = jax.vmap(center_and_log_sides)(ensemble.q_TN)
    mean = jnp.mean(boxes, axis=0)
    change = boxes - mean[None, :]
    half = 0.5 * jnp.exp(mean[2:])
    grown = half[None, :] * change[:, 2:]
    return EnsembleOutlines(
        mean=jnp.concatenate([mean[:2] - half, mean[:2] + half]),
        deviations=jnp.concatenate([change[:, :2] - grown, change[:, :2] + grown], axis=1),
        log_aspects=boxes[:, 2] - boxes[:, 3],
    )


def observe_ensemble(
    ensemble: TargetEnsemble, outlines: EnsembleOutlines, used: Array, dt: float
) -> tuple[TargetEnsemble, OutlineCorrelation]:
    """Ensemble after a frame whose box was `used` or not and `dt` [s] until the next, and its mean correlation."""

    def observe(state: OutlineCorrelation, log_aspect: Array) -> OutlineCorrelation:
        after = outline_correlation.update(state, log_aspect, jnp.zeros_like(log_aspect), used)
        return outline_correlation.elapse(after, dt)

    outline = jax.vmap(observe)(ensemble.outline, outlines.log_aspects)
    return replace(ensemble, outline=outline), jax.tree.map(lambda values: jnp.mean(values, axis=0), outline)


def target_outline(scenario: Scenario, params: Params, q_TN: Float[Array, "4"], truth: Truth) -> Float[Array, "4"]:
    """Edges [px] of the box of a target at attitude `q_TN` in the true camera, not cut by the frame."""
    lens = params.camera.lens(scenario.width_px, scenario.height_px)
    pose = camera_pose.target_pose_in_camera(params.camera, q_TN, truth.r_ST_N, truth.q_BN)
    return box_projection.projected_box(lens, camera_pose.hull_in_camera(params.plant.target.true_hull, *pose))
