"""Tuning of the orbit filter and of its outlier gate."""

from jaxtyping import Array

from rpojax.core.declared_numbers import number
from rpojax.core.pytree import pytree


@pytree
class OrbitFilterTuning:
    """Noise model of the orbit filter, and thresholds of its gate.

    Attributes:
        detector_boxes: () 1 where a detector finds the boxes, so that they have that offset, else 0 [-]
        burn_scale_as_new: () factor on `burn_scale_sigma` and `thrust_direction_sigma` of what counts as new in each
            burn, where the filter has no state for it; 0 where it has one [-]
        gate_slope_width: () width of the slope that gates have in derivatives, in squared sigmas; infinite for the
            steps that they are. No value depends on it
    """

    gps_noise: Array = number("white GPS noise per axis, 1 sigma", unit="m", above=0.0)
    gps_error_sigma: Array = number("slowly varying GPS error per axis, 1 sigma; a filter state", unit="m", above=0.0)
    gps_error_time_constant: Array = number("its correlation time", unit="s", above=0.0)
    edge_noise: Array = number("noise of a box edge, 1 sigma", unit="px", above=0.0)
    minimum_size: Array = number(
        "largest side of a target below which the camera finds no box; a frame without one then tells of the size",
        unit="px",
        above=0.0,
        default=4.0,
    )
    miss_probability: Array = number(
        "probability of a frame without a box of a larger target, false boxes in its place included",
        above=0.0,
        below=1.0,
        default=0.1,
    )
    center_sigma: Array = number(
        "offset of the box centre from the centre of mass per axis, 1 sigma; a filter state", unit="m", at_least=0.0
    )
    detector_center_sigma: Array = number(
        "what the filter believes of the offset between the centres of box and outline, varying with attitude and "
        "light, 1 sigma; it adds its variance to that of `navigation.center_sigma_m`. No image is changed by it",
        key="imaging.center_sigma_m",
        at_least=0.0,
    )
    detector_boxes: Array
    center_perspective: Array = number(
        "the same because nearer parts look greater, 1 sigma at a range of `target_size_m`, over that size",
        at_least=0.0,
        default=0.152,
    )
    center_time_constant: Array = number("its correlation time, about a twelfth of a tumble", unit="s", above=0.0)
    target_size: Array = number("mean of the square root of width times height of the outline", unit="m", above=0.0)
    target_size_sigma: Array = number(
        "error of the log of that size, which stays; adds to the variance of the slow part below, 1 sigma",
        at_least=0.0,
        default=0.0,
    )
    outline_time_constant: Array = number(
        "correlation time of the log of width over height for which `center_time_constant_s` and the second of "
        "`scale_time_constant_s` hold; the filter estimates it from the boxes and changes these in proportion",
        unit="s",
        above=0.0,
        default=33.0,
    )
    largest_side_log: Array = number(
        "log of the largest side of the outline over the square root of width times height: mean and 1 sigma over "
        "attitude. With `minimum_size_px` it says from which size on a target is found",
        length=2,
        above=0.0,
        default=[0.204, 0.124],
    )
    scale_sigma: Array = number(
        "error of the log of that size over attitude, slow and fast part, 1 sigma; filter states", length=2, above=0.0
    )
    scale_time_constant: Array = number(
        "their correlation times; the first at a line of sight that turns once in 95 minutes: the filter changes it "
        "in inverse proportion to the rate at which the estimated one turns, between a quarter and 40 times",
        unit="s",
        length=2,
        above=0.0,
    )
    nearest_surface: Array = number(
        "mean distance of the surface that a range finder meets from the centre of mass, towards the servicer, over "
        "`target_size_m`. Used with `range_finder`",
        at_least=0.0,
        default=0.305,
    )
    nearest_surface_sigma: Array = number(
        "error of that distance over attitude, slow and fast part, over `target_size_m`, 1 sigma; filter states with "
        "the correlation times of the slow part of the size and of `center_time_constant_s`. Used with `range_finder`",
        length=2,
        above=0.0,
        default=[0.015, 0.048],
    )
    centroid: Array = number(
        "mean distance of the centroid of a LiDAR's returns from the centre of mass, towards the servicer, over "
        "`target_size_m`. Used with `lidar`",
        at_least=0.0,
        default=0.15,
    )
    centroid_sigma: Array = number(
        "error of the centroid over attitude: slow and fast part along the line of sight, and the same across per "
        "axis, over `target_size_m`, 1 sigma; filter states like those of `nearest_surface_sigma`. Used with `lidar`",
        length=4,
        above=0.0,
        default=[0.025, 0.055, 0.02, 0.035],
    )
    tumble_sigma: Array = number(
        "rate of the target per axis when its attitude is first found, 1 sigma. Used with `landmarks`",
        unit="deg_s",
        above=0.0,
        default=1.5,
    )
    tumble_walk: Array = number(
        "random walk of that rate, by torques that are not modelled. Used with `landmarks`",
        unit="deg_s_sqrt_s",
        at_least=0.0,
        default=2e-5,
    )
    inertia_ratio_sigma: Array = number(
        "error of the log of the first and of the second moment of inertia of the target over the third, 1 sigma; "
        "filter states. Used with `landmarks`",
        above=0.0,
        default=0.03,
    )
    body_offset_sigma: Array = number(
        "place of the target's landmarks from where they are thought to be about its centre of mass, per axis, 1 "
        "sigma; a filter state. Used with `landmarks`",
        unit="m",
        above=0.0,
        default=0.01,
    )
    network_turn_sigma: Array = number(
        "error of the attitude that a landmark network shows from picture to picture alike, across and about the "
        "boresight, per axis, 1 sigma; filter states. Used with `landmarks` of a rendered or statistical camera, as "
        "are the next two",
        unit="deg",
        length=2,
        above=0.0,
        default=[1.5, 0.7],
    )
    network_place_sigma: Array = number(
        "the same of the place of the target, across and along the boresight, over the range; filter states",
        length=2,
        above=0.0,
        default=[0.0012, 0.02],
    )
    network_angle: Array = number(
        "angle by which the target turns before the camera until the correlation of these errors is 1 / e",
        unit="deg",
        above=0.0,
        default=13.0,
    )
    bearing_bias_sigma: Array = number("constant bearing error per axis, 1 sigma; a state", unit="deg", above=0.0)
    attitude_sigma: Array = number("noise of the estimated camera attitude per axis, 1 sigma", unit="deg", at_least=0.0)
    acceleration_noise: Array = number("unmodelled acceleration of the servicer", unit="m_s2_sqrt_hz", at_least=0.0)
    relative_acceleration_noise: Array = number("unmodelled relative acceleration", unit="m_s2_sqrt_hz", at_least=0.0)
    burn_magnitude_sigma: Array = number(
        "relative error of the velocity change of a burn, 1 sigma, that is new in every burn", at_least=0.0
    )
    burn_scale_sigma: Array = number(
        "the same, of the part that stays from burn to burn: of thrust and mass. The filter estimates it. With "
        "`sharing` the filters have no state for it: twice its sigma counts as new in every burn",
        at_least=0.0,
        default=0.05,
    )
    burn_scale_as_new: Array
    burn_direction_sigma: Array = number(
        "direction error of a burn per axis, new in every burn, 1 sigma", unit="deg", at_least=0.0
    )
    thrust_direction_sigma: Array = number(
        "angle of the thrust per axis, lasting from burn to burn, 1 sigma", unit="deg", at_least=0.0, default=0.5
    )
    ballistic_sigma: Array = number(
        "area over mass of the target less that of the servicer, 1 sigma", unit="m2_kg", at_least=0.0, default=0.005
    )
    adaptation_limit: Array = number(
        "greatest factor on the prior sigma of an error that lasts (1.15 times the declared one), where measurements "
        "contradict it",
        at_least=1.0,
        default=6.0,
    )
    thrust_sigma: Array = number(
        "relative error of the thrust before any measured pressure, 1 sigma: of one burn and lasting, as "
        "`thruster.magnitude_noise` and `force_scale` have it; mass has no part in it. Used with `chamber_pressure`",
        above=0.0,
        default=0.015,
    )
    thrust_walk: Array = number(
        "random walk of the relative thrust while the thruster burns, by which the pressure of a new burn outweighs "
        "those of earlier ones. Used with `chamber_pressure`",
        unit="sqrt_s",
        above=0.0,
        default=0.01,
    )
    pressure_noise: Array = number(
        "noise of the chamber pressure as a fraction of the nominal one, 1 sigma. Used with `chamber_pressure`",
        above=0.0,
        default=0.03,
    )
    gate_slope_width: Array
    gate_sigma: Array = number("boxes beyond this many sigma in bearing or log size are rejected", above=0.0)
    confirm_tolerance: Array = number(
        "a box whose direction is this close to that of an earlier one, per second in between (at least one), "
        "agrees with it. An angle: another focal length or image size does not change what it allows",
        unit="deg_s",
        above=0.0,
    )
    confirm_above: Array = number(
        "while the bearing is less certain than this many box sigmas, boxes before it must confirm a box", above=0.0
    )
    confirm_within: Array = number("longest time between boxes that agree, at least three frames", unit="s", above=0.0)
    recovery_after: Array = number(
        "time of rejected boxes that others confirm, each for at most a second, without an accepted one that inflates "
        "the covariance",
        unit="s",
        above=0.0,
    )
    recovery_position_sigma: Array = number("inflation of the position sigma, as a fraction of the range", at_least=0.0)
    recovery_velocity_sigma: Array = number("inflation of the velocity sigma per axis", unit="m_s", at_least=0.0)
    initial_position_sigma: Array = number(
        "error of the servicer's position at the start per axis, 1 sigma", unit="m", above=0.0
    )
    initial_velocity_sigma: Array = number("the same of its velocity", unit="m_s", above=0.0)
    initial_relative_position_sigma: Array = number(
        "error of the relative position at the start per axis, 1 sigma", unit="m", above=0.0
    )
    initial_relative_velocity_sigma: Array = number("the same of the relative velocity", unit="m_s", above=0.0)
