"""Tuning of the orbit filter and of its outlier gate."""

from jaxtyping import Array

from rpojax.core.pytree import pytree


@pytree
class OrbitFilterTuning:
    """Noise model of the orbit filter, and thresholds of its gate.

    Attributes:
        gps_noise: () white noise per axis, 1 sigma [m]
        gps_error_sigma: () slowly varying error per axis, 1 sigma [m]
        gps_error_time_constant: () [s]
        edge_noise: () of a box edge, 1 sigma [px]
        minimum_size: () largest side of a target below which the camera finds no box [px]
        miss_probability: () of a frame without a box of a larger target [-]
        center_sigma: () offset of the box centre from the centre of mass, per axis, 1 sigma [m]
        detector_center_sigma: () offset of a detector's box centre from that of the outline, as attitude and light
            change, per axis, 1 sigma [m]
        detector_boxes: () 1 where a detector finds the boxes, so that they have that offset, else 0 [-]
        center_perspective: () offset of the centre by perspective, times the range and over the square of the size, per
            axis, 1 sigma [-]
        center_time_constant: () of that offset: a sixth of a tumble [s]
        target_size: () expected sqrt(width height) of the target's outline [m]
        target_size_sigma: () error of its log, 1 sigma [-]
        outline_time_constant: () correlation time of the log aspect ratio at which the other time constants hold [s]
        largest_side_log: (2,) log of the outline's largest side over sqrt(width height), mean and 1 sigma [-]
        scale_sigma: (2,) log-size error, slow and fast part, 1 sigma [-]
        scale_time_constant: (2,) [s]
        bearing_bias_sigma: () per axis, 1 sigma [rad]
        attitude_sigma: () camera attitude noise per axis, 1 sigma [rad]
        acceleration_noise: () unmodelled absolute acceleration [m/s^2 per Hz^0.5]
        relative_acceleration_noise: () unmodelled relative acceleration [m/s^2 per Hz^0.5]
        burn_magnitude_sigma: () fraction of a burn's velocity change along it, new in each burn, 1 sigma [-]
        burn_scale_sigma: () the same, lasting from burn to burn: thrust and mass, 1 sigma [-]
        burn_scale_as_new: () factor on `burn_scale_sigma` and `thrust_direction_sigma` of what counts as new in each
            burn, where the filter has no state for it; 0 where it has one [-]
        burn_direction_sigma: () fraction across it, per axis, new in each burn, 1 sigma [rad]
        thrust_direction_sigma: () angle of the thrust, lasting from burn to burn, per axis, 1 sigma [rad]
        ballistic_sigma: () area over mass of the target less that of the servicer, 1 sigma [m^2/kg]
        adaptation_limit: () greatest factor on the declared sigma of an error that lasts, where measurements
            contradict it [-]
        thrust_sigma: () relative error of the thrust before any pressure is measured, new and lasting, 1 sigma [-]
        thrust_walk: () random walk of the relative thrust while burning [1/s^0.5]
        pressure_noise: () of the chamber pressure, as a fraction of the nominal one, 1 sigma [-]
        gate_sigma: () boxes beyond this many sigma in bearing or log-range are rejected [-]
        confirm_tolerance: () two boxes confirm each other when closer than this for each second between them [rad/s]
        confirm_above: () confirmation is required when bearing is less certain than this many box sigmas [-]
        confirm_within: () longest time between two boxes that confirm each other, or one frame if that is longer [s]
        recovery_after: () of rejected boxes, a box for at most a second, that triggers covariance inflation [s]
        recovery_position_sigma: () position sigma added then, as a fraction of the range [-]
        recovery_velocity_sigma: () velocity sigma added then [m/s]
        initial_position_sigma: () servicer, per axis [m]
        initial_velocity_sigma: () servicer, per axis [m/s]
        initial_relative_position_sigma: () per axis [m]
        initial_relative_velocity_sigma: () per axis [m/s]
    """

    gps_noise: Array
    gps_error_sigma: Array
    gps_error_time_constant: Array
    edge_noise: Array
    minimum_size: Array
    miss_probability: Array
    center_sigma: Array
    detector_center_sigma: Array
    detector_boxes: Array
    center_perspective: Array
    center_time_constant: Array
    target_size: Array
    target_size_sigma: Array
    outline_time_constant: Array
    largest_side_log: Array
    scale_sigma: Array
    scale_time_constant: Array
    bearing_bias_sigma: Array
    attitude_sigma: Array
    acceleration_noise: Array
    relative_acceleration_noise: Array
    burn_magnitude_sigma: Array
    burn_scale_sigma: Array
    burn_scale_as_new: Array
    burn_direction_sigma: Array
    thrust_direction_sigma: Array
    ballistic_sigma: Array
    adaptation_limit: Array
    thrust_sigma: Array
    thrust_walk: Array
    pressure_noise: Array
    gate_sigma: Array
    confirm_tolerance: Array
    confirm_above: Array
    confirm_within: Array
    recovery_after: Array
    recovery_position_sigma: Array
    recovery_velocity_sigma: Array
    initial_position_sigma: Array
    initial_velocity_sigma: Array
    initial_relative_position_sigma: Array
    initial_relative_velocity_sigma: Array
