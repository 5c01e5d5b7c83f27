"""Checks that the lamp lights the target that the scenario flies to."""

from rpojax.errors import ScenarioError
from rpojax.scenario.checks.ranging_checks import angle_from_camera_deg, nearest_station_m
from rpojax.scenario.schema import ScenarioFile


def check_lamp(file: ScenarioFile) -> None:
    """Refuses a lamp that never lights the target, and one of a camera that has pictures under the Sun alone.

    Raises:
        ScenarioError: naming the key.
    """
    lamp, dispersed = file.lamp, [key for entry in file.dispersions for key in entry.key_texts]
    if lamp is None or (lamp.reach_m == 0.0 and "lamp.reach_m" not in dispersed):
        return
    if file.camera.model == "rendered":
        expected = "'geometric' or 'statistical' with a [lamp] that is on: the radiance field has one light, the Sun"
        raise ScenarioError("camera.model", file.camera.model, expected)
    nearest = nearest_station_m(file)
    if nearest is not None and lamp.reach_m < nearest:
        expected = f"at least {nearest:g}, the distance of the nearest station from the target"
        raise ScenarioError("lamp.reach_m", lamp.reach_m, expected)
    if angle_from_camera_deg(file, lamp.boresight) > lamp.beam_half_angle_deg:
        expected = f"a direction within beam_half_angle_deg = {lamp.beam_half_angle_deg:g} of the camera's boresight"
        raise ScenarioError("lamp.boresight", lamp.boresight, expected)
