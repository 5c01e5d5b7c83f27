"""Tumbling targets, as many as stand for all attitudes and tumbles, and the outlines that they show along one view."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from rpojax.core import quaternion, random_streams
from rpojax.core.numerics import runge_kutta
from rpojax.core.pytree import pytree, replace
from rpojax.dispersions import dispersed_values
from rpojax.physics import environment, rigid_body
from rpojax.physics.plant import Truth
from rpojax.scenario import dispersion_keys
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors import geometric_camera
from rpojax.vision import bounding_box, pinhole

KEYS = ("target.attitude", "target.tumble_axis", "target.tumble_rate_deg_s")
"""Keys whose dispersion is an ensemble and no derivative."""
_LEAST_SIDE_PX = 0.1


@pytree
class TargetEnsemble:
    """Attitudes of the targets.

    Attributes:
        q_TN: (members, 4)
        omega_TN_T: (members, 3) [rad/s]
    """

    q_TN: Array
    omega_TN_T: Array


@pytree
class EnsembleOutlines:
    """Boxes around the targets on one frame, compared in centre and in logarithm of the sides.

    Attributes:
        mean: (4,) edges with the mean centre and the mean logarithms [px]
        deviations: (members, 4) of the edges from those, to first order [px]
    """

    mean: Array
    deviations: Array


@pytree
class RelativeBox:
    """A box relative to another one.

    Attributes:
        offset: (2,) between the centres [px]
        ratio: (2,) of width and height
    """

    offset: Array
    ratio: Array


def relative_box(own: Float[Array, "4"], other: Float[Array, "4"]) -> RelativeBox:
    """How a box (edges [px]) lies about another one."""
    sides = jnp.maximum(own[2:] - own[:2], _LEAST_SIDE_PX)
    return RelativeBox(
        offset=bounding_box.box_center(other) - bounding_box.box_center(own), ratio=(other[2:] - other[:2]) / sides
    )


def apply_relative_box(own: Float[Array, "4"], framing: RelativeBox) -> Float[Array, "4"]:
    """Edges [px] of the box that lies so about `own`."""
    center = bounding_box.box_center(own) + framing.offset
    half = 0.5 * framing.ratio * (own[2:] - own[:2])
    return jnp.concatenate([center - half, center + half])


def initial_ensemble(file: ScenarioFile, params: Params, members: int) -> TargetEnsemble:
    """Targets whose attitude, tumble axis and rate fill their dispersions evenly; one if these are not dispersed."""
    entries = [entry for entry in file.dispersions if dispersion_keys.dispersion_name(entry) in KEYS]
    kept = file.model_copy(update={"dispersions": entries})
    count = members if entries else 1
    coordinates = [dispersion_keys.coordinate_count(file, entry) for entry in entries]
    unit = np.clip(qmc.Sobol(max(sum(coordinates), 1), scramble=True, rng=0).random(count), 1e-12, 1.0 - 1e-12)
    columns = np.split(unit[:, : sum(coordinates)], np.cumsum(coordinates)[:-1], axis=1) if entries else []
    given = {
        dispersion_keys.dispersion_name(entry): jnp.asarray(part) for entry, part in zip(entries, columns, strict=True)
    }

    def one(given: dict[str, Array], _: Array) -> TargetEnsemble:
        target = dispersed_values.apply_to_params(
            params, dispersed_values.draw(kept, random_streams.master_key(0), given)
        ).plant.target
        return TargetEnsemble(
            q_TN=quaternion.normalize(target.attitude),
            omega_TN_T=target.tumble_rate * quaternion.normalize(target.tumble_axis),
        )

    return jax.vmap(one)(given, jnp.zeros(count))


def propagate_ensemble(scenario: Scenario, params: Params, tumble: TargetEnsemble, r_TN_N: Array) -> TargetEnsemble:
    """Attitudes one tick later; the target is at `r_TN_N` [m]. Air and light turn it too little to matter here."""
    inertia = params.plant.target.inertia
    inverse = rigid_body.inverse_3x3(inertia)

    def derivative(y: TargetEnsemble, _: Array) -> TargetEnsemble:
        torque = jnp.zeros(3)
        if scenario.effects.gravity_gradient:
            r_T = quaternion.rotate(y.q_TN, r_TN_N)
            torque = environment.gravity_gradient_torque(r_T, inertia, params.plant.gravity.mu)
        return TargetEnsemble(
            q_TN=quaternion.derivative(y.q_TN, y.omega_TN_T),
            omega_TN_T=rigid_body.angular_acceleration(inertia, inverse, y.omega_TN_T, torque),
        )

    def one(y: TargetEnsemble) -> TargetEnsemble:
        after = runge_kutta.rk4(derivative, y, jnp.zeros(3), scenario.tick_s)
        return replace(after, q_TN=quaternion.normalize(after.q_TN))

    return jax.vmap(one)(tumble)


def ensemble_outlines(scenario: Scenario, params: Params, tumble: TargetEnsemble, truth: Truth) -> EnsembleOutlines:
    """Outlines of the targets at the place of the true one, through the true camera."""

    def one(q_TN: Float[Array, "4"]) -> Array:
        edges = target_outline(scenario, params, q_TN, truth)
        sides = jnp.maximum(edges[2:] - edges[:2], _LEAST_SIDE_PX)
        return jnp.concatenate([bounding_box.box_center(edges), jnp.log(sides)])

    places = jax.vmap(one)(tumble.q_TN)
    mean = jnp.mean(places, axis=0)
    change = places - mean[None, :]
    half = 0.5 * jnp.exp(mean[2:])
    grown = half[None, :] * change[:, 2:]
    return EnsembleOutlines(
        mean=jnp.concatenate([mean[:2] - half, mean[:2] + half]),
        deviations=jnp.concatenate([change[:, :2] - grown, change[:, :2] + grown], axis=1),
    )


def target_outline(scenario: Scenario, params: Params, q_TN: Float[Array, "4"], truth: Truth) -> Float[Array, "4"]:
    """Edges [px] of a target at attitude `q_TN` as the true camera would see it, not cut by the frame."""
    lens = pinhole.pinhole_intrinsics(params.camera.field_of_view, scenario.width_px, scenario.height_px)
    placed = geometric_camera.target_pose_in_camera(params.camera, q_TN, truth.r_ST_N, truth.q_BN)
    return bounding_box.projected_box(lens, geometric_camera.hull_in_camera(params.plant.target.hull, *placed))
