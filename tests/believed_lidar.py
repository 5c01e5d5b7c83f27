"""A plugin: a LiDAR that looks along the body's x axis, with range and two angles, which the orbit filter believes."""

import jax.numpy as jnp
from jax.scipy.stats import norm

import rpojax
from rpojax.core import quaternion


class Lidar(rpojax.AdditionalSensor):
    """Range and direction of the target within reach and cone, in any light; some measurements are missing."""

    noise_m: float
    angle_noise_deg: float
    miss_probability: float
    reach_m: float
    cone_deg: float
    believed_noise_m: float
    believed_angle_noise_deg: float

    normals = 4
    beliefs = ("believed_noise_m", "believed_angle_noise_deg")
    row_count = 3
    shows_direction = True

    @staticmethod
    def measure(settings, scene, normals):
        """Range [m], and angles towards body y and z [rad]; NaN where there is none."""
        ideal = _range_and_angles(scene.truth.q_BN, -scene.truth.r_ST_N)
        noise = jnp.stack([settings["noise"], settings["angle_noise"], settings["angle_noise"]])
        hit = (ideal[0] < settings["reach"]) & (jnp.max(jnp.abs(ideal[1:])) < settings["cone"])
        hit = hit & (norm.cdf(normals[3]) > settings["miss_probability"])
        found = jnp.where(hit, ideal + noise * normals[:3], jnp.nan)
        return {"ranger_m": found[0], "ranger_rad": found[1:]}

    @staticmethod
    def rows(beliefs, view, measured):
        """The same of the estimate, with the believed noise."""
        values = jnp.concatenate([measured["ranger_m"][None], measured["ranger_rad"]])
        angle = beliefs["believed_angle_noise"]
        variance = jnp.stack([beliefs["believed_noise"], angle, angle]) ** 2
        present = jnp.isfinite(measured["ranger_m"])
        return view.rows(lambda estimate: _range_and_angles(view.q_BN, estimate.r_TS_N), values, variance, present)


def _range_and_angles(q_BN, r_TS_N):
    x, y, z = quaternion.rotate(q_BN, r_TS_N)
    return jnp.stack([jnp.sqrt(x * x + y * y + z * z), jnp.arctan2(y, x), jnp.arctan2(z, x)])


def setup():
    """What the scenario gets."""
    return rpojax.Plugin(sensors={"ranger": Lidar})
