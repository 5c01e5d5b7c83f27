"""Checks that range finder and LiDAR can measure the target that the scenario flies to."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from rpojax.errors import ScenarioError
from rpojax.scenario.phases.reference_sections import ApproachSection, FlyAroundSection, HoldSection, TransferSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors.additional.lidar import Lidar
from rpojax.sensors.additional.range_finder import RangeFinder

_HALF_SIZE: Final = 0.5
"""Distance from the centre within which a range finder on the pointed axis meets the target, over its size [-]."""


def check_ranging(file: ScenarioFile) -> None:
    """Refuses a range finder or LiDAR that never meets the target.

    Raises:
        ScenarioError: naming the key.
    """
    nearest = nearest_station_m(file)
    for name, sensor in (("range_finder", file.range_finder), ("lidar", file.lidar)):
        if sensor is None:
            continue
        if nearest is not None and sensor.maximum_range_m <= nearest:
            expected = f"more than {nearest:g}, the distance of the nearest station from the target"
            raise ScenarioError(f"{name}.maximum_range_m", sensor.maximum_range_m, expected)
        off = angle_from_camera_deg(file, sensor.boresight)
        if off > (limit := _largest_angle_deg(file, sensor, nearest)):
            expected = f"a direction within {limit:.3g} deg of the camera's boresight, which points at the target"
            raise ScenarioError(f"{name}.boresight", sensor.boresight, expected)


def nearest_station_m(file: ScenarioFile) -> float | None:
    """Least distance from the target at which a phase ends or stays [m], None if no phase says it."""
    if not file.phases:
        return math.hypot(*file.formation.desired_position_m)
    found = []
    for phase in file.phases:
        reference = phase.reference
        if isinstance(reference, HoldSection | TransferSection):
            found.append(math.hypot(*reference.position_m))
        elif isinstance(reference, ApproachSection):
            found.append(math.hypot(*reference.end_position_m))
        elif isinstance(reference, FlyAroundSection):
            found.append(reference.radius_m)
    return min(found, default=None)


def angle_from_camera_deg(file: ScenarioFile, boresight: Sequence[float] | np.ndarray) -> float:
    """Angle [deg] between a direction in B and the camera's boresight, which points at the target."""
    w, x, y, z = file.camera.mounting
    # q_KB of this convention rotates components; its inverse takes the camera's axis to the body.
    axis_B = Rotation.from_quat([x, y, z, w]).inv().apply([0.0, 0.0, 1.0])
    cosine = float(np.dot(axis_B, boresight)) / math.hypot(*boresight)
    return math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))


def _largest_angle_deg(file: ScenarioFile, sensor: RangeFinder | Lidar, nearest_m: float | None) -> float:
    """Angle from the pointed axis beyond which the sensor does not meet the target."""
    if isinstance(sensor, Lidar):
        return sensor.field_half_angle_deg
    reach = sensor.beam_half_angle_deg
    if nearest_m is None:
        return 90.0
    return reach + math.degrees(math.atan2(_HALF_SIZE * file.navigation.target_size_m, nearest_m))
