"""A plugin: two metrics, a range sensor and a controller."""

import jax.numpy as jnp

import rpojax


@rpojax.metric("max", title="Largest angle off the track")
def docking_angle_deg(rho_H):
    """Angle between the approach axis, along the track, and the line to the servicer."""
    return jnp.rad2deg(jnp.arctan2(jnp.hypot(rho_H[0], rho_H[2]), -rho_H[1]))


def ranger_hit_fraction(ranger_m):
    """Share of the ticks in which the ranger has a measurement; of a whole run, in NumPy."""
    return (ranger_m > 0.0).mean()


class Ranger(rpojax.AdditionalSensor):
    """Range finder without a beam: it sees the target wherever it is."""

    noise_m: float
    reach_m: float
    normals = 1

    @staticmethod
    def measure(settings, scene, normals):
        """Range [m]; NaN out of reach."""
        distance = jnp.linalg.norm(scene.truth.r_ST_N)
        measured = distance + settings["noise"] * normals[0]
        return {"ranger_m": jnp.where(distance < settings["reach"], measured, jnp.nan)}


def cautious_law(gain, deviation):
    """Packaged feedback, at most 2 cm/s for one burn."""
    wanted = -gain @ deviation
    return wanted * jnp.minimum(1.0, 0.02 / jnp.maximum(jnp.linalg.norm(wanted), 1e-9))


def setup():
    """What the scenario gets."""
    return rpojax.Plugin(
        metrics={"docking_angle_deg": docking_angle_deg, "ranger_hit_fraction": ranger_hit_fraction},
        sensors={"ranger": Ranger},
        stages=rpojax.Stages(formation_law=cautious_law),
    )
