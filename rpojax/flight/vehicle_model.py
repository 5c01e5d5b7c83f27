"""Flight software's model of its own vehicle, with nominal values."""

from jaxtyping import Array

from rpojax.core.lamp import Lamp
from rpojax.core.pytree import pytree


@pytree
class VehicleModel:
    """Nominal properties of the servicer, which the true ones differ from.

    Attributes:
        mass: () [kg]
        inertia: (3, 3) wheels locked [kg m^2]
        thrust: () [N]
        minimum_on_time: () of the thruster [s]
        thrust_direction: (3,) force in B, unit
        wheel_axes: (3, 3) one a row
        wheel_inertia: (3,) [kg m^2]
        wheel_torque_limit: (3,) [N m]
        camera_mounting: (4,) q_KB
        focal_px: () [px]
        phase_limit: () of the camera [rad]
        sun_exclusion: () of the camera [rad]
        dark_reach: () range within which a LiDAR shows the target without light [m], None without one
        lamp: that lights the target, None without one
        distortion: (5,) of the camera's lens, None for a pinhole
    """

    mass: Array
    inertia: Array
    thrust: Array
    minimum_on_time: Array
    thrust_direction: Array
    wheel_axes: Array
    wheel_inertia: Array
    wheel_torque_limit: Array
    camera_mounting: Array
    focal_px: Array
    phase_limit: Array
    sun_exclusion: Array
    dark_reach: Array | None = None
    lamp: Lamp | None = None
    distortion: Array | None = None
