"""Camera parameters, and the record of one exposure, common to all camera models."""

from jaxtyping import Array

from rpojax.core.pytree import pytree
from rpojax.vision.bounding_box import BoundingBox


@pytree
class Camera:
    """True parameters of the camera and of its bounding-box detector.

    Attributes:
        field_of_view: () horizontal [rad]
        mounting: (4,) nominal q_KB
        misalignment: (3,) small rotation of the camera about its own axes [rad]
        edge_noise: () error of each box edge, 1 sigma [px]
        miss_probability: () fraction of observable frames without a box [-]
        minimum_size: () smaller targets are not detected [px]
        outlier_probability: () fraction of frames whose box is false [-]
        outlier_size_min: () [px]
        outlier_size_max: () [px]
        phase_limit: () largest Sun-target-camera angle with a usable image [rad]
        sun_exclusion: () least angle between line of sight and Sun [rad]
    """

    field_of_view: Array
    mounting: Array
    misalignment: Array
    edge_noise: Array
    miss_probability: Array
    minimum_size: Array
    outlier_probability: Array
    outlier_size_min: Array
    outlier_size_max: Array
    phase_limit: Array
    sun_exclusion: Array


@pytree
class CameraFrame:
    """Result of one exposure.

    Attributes:
        box: the box that the flight software gets
        observable: () bool, the light allows to see the target, whether or not the camera works
        score: () 0..1 of the detector's best box, accepted or not; 1 or 0 without a detector
        window: (3,) left, top and side [px] of the square that the detector got
        outlier: () bool, the box is false (not known to flight software)
        outline: (4,) true left, top, right, bottom of the target, cut to the frame [px] (not known to flight software)
    """

    box: BoundingBox
    observable: Array
    score: Array
    window: Array
    outlier: Array
    outline: Array
