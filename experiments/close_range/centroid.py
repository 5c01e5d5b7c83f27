"""True scatter of the LiDAR's centroid: by how much that of 64 beams is off that of 4096, at 3 to 50 m.

python experiments/close_range/centroid.py [--frames 300] [--seed 0]

Each frame has the target of `night_approach` in a random attitude, in the middle of the cone of flight software that
knows its place to some centimetres, and a sensor without noise. What is left is the sampling of which the filter is
told as `_SPREAD` times the target's size over the number of returns to the power of 3/4; the table has that factor.
"""

import argparse
from collections.abc import Callable
from typing import Final
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np

import rpojax
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.flight.guidance.sight_cone import SightCone
from rpojax.sensors.additional import lidar
from rpojax.sensors.additional.additional_sensor import SensedScene

RANGES_M: Final = (3.0, 5.0, 10.0, 20.0, 35.0, 50.0)
MANY: Final = 4096
CONE_M: Final = 1.1
"""Radius of the cone at the target [m]: its 0.95 m, and three sigma of its place."""


def main() -> None:
    """Prints one row for each range."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rpojax.prepare_process()
    rng = np.random.default_rng(options.seed)
    q_TN = rng.normal(size=(options.frames, 4))
    q_TN = jnp.asarray(q_TN / np.linalg.norm(q_TN, axis=1, keepdims=True))
    times = jnp.asarray(rng.uniform(0.0, 1000.0, options.frames))
    few, many = (_centroids(rays) for rays in (lidar.RAYS, MANY))
    size = rpojax.load("night_approach").navigation.target_size_m
    print("range   returns   rms along   across   factor along   across")
    for reach in RANGES_M:
        found, count = map(np.asarray, few(q_TN, times, reach))
        counted = count > 0
        error = (found - np.asarray(many(q_TN, times, reach)[0]))[counted]
        scaled = error * (count[counted] ** 0.75 / size)[:, None]
        along, across = (np.sqrt(np.mean(each**2)) for each in (error[:, 0], error[:, 1:]))
        factors = (np.sqrt(np.mean(each**2)) for each in (scaled[:, 0], scaled[:, 1:]))
        print(
            f"{reach:4g} m   {count.mean():6.1f}   {along:.4f} m  {across:.4f} m   "
            + "   ".join(f"{each:.3f}" for each in factors)
        )


def _centroids(rays: int) -> Callable[[jax.Array, jax.Array, float], tuple[jax.Array, jax.Array]]:
    """Centroids (n, 3) in B [m] and numbers of returns (n,) of frames of `rays` beams at one range."""
    _, params, state = rpojax.initialise_run(rpojax.load("night_approach"), 0, 0)
    settings = {**params.additional_sensors["lidar"], "noise": jnp.zeros(()), "angle_noise": jnp.zeros(())}
    sky = SunMoonPositions(sun_N=jnp.ones(3), moon_N=jnp.ones(3))

    @jax.jit
    def measured(q_TN: jax.Array, times: jax.Array, reach: jax.Array) -> tuple[jax.Array, jax.Array]:
        def frame(each: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
            ahead = jnp.stack([-reach, 0.0 * reach, 0.0 * reach])
            truth = replace(state.truth, r_ST_N=ahead, q_BN=jnp.array([1.0, 0.0, 0.0, 0.0]), q_TN=each[0])
            cone = SightCone(axis_B=jnp.array([1.0, 0.0, 0.0]), half_angle=jnp.arctan(CONE_M / reach))
            scene = SensedScene(truth=truth, sky=sky, time=each[1], surface=params.surface, cone=cone)
            found = lidar.Lidar.measure(settings, scene, jnp.zeros(3))
            return found["lidar_centroid_m"], found["lidar_returns_count"]

        return jax.lax.map(frame, (q_TN, times))

    def patched(q_TN: jax.Array, times: jax.Array, reach: float) -> tuple[jax.Array, jax.Array]:
        with mock.patch.object(lidar, "RAYS", rays):
            return measured(q_TN, times, jnp.asarray(reach))

    return patched


if __name__ == "__main__":
    main()
