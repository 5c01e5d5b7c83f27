"""Values that the schema of the sections refuses."""

import pytest
from scenario_error_assertions import assert_one_line

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader

BAD_VALUES = {
    "negative mass": ("servicer.mass_kg=-1.0", "servicer.mass_kg", "greater than 0"),
    "zero mass": ("servicer.mass_kg=0.0", "servicer.mass_kg", "greater than 0"),
    "nan": ("servicer.mass_kg=nan", "servicer.mass_kg", "finite"),
    "infinite": ("gps.noise_m=inf", "gps.noise_m", "finite"),
    "nan in a vector": ("initial.relative_position_m=[0.0, nan, 0.0]", "initial.relative_position_m.1", "finite"),
    "a word for a number": ("servicer.mass_kg=heavy", "servicer.mass_kg", "number"),
    "a quoted number": ('servicer.mass_kg="30.0"', "servicer.mass_kg", "number"),
    "a flag for a number": ("thruster.force_n=true", "thruster.force_n", "number"),
    "a number for a vector": ("wheels.inertia_kg_m2=0.1", "wheels.inertia_kg_m2", "list"),
    "a fraction for a whole number": ("camera.width_px=128.5", "camera.width_px", "integer"),
    "a list for a section": ("servicer=[1.0]", "servicer", "a table"),
    "a vector too short": ("initial.relative_position_m=[0.0, -50.0]", "initial.relative_position_m", "3"),
    "a vector too long": ("wheels.torque_limit_n_m=[0.1, 0.1, 0.1, 0.1]", "wheels.torque_limit_n_m", "3"),
    "a quaternion too short": ("target.attitude=[1.0, 0.0, 0.0]", "target.attitude", "4"),
    "a matrix with two rows": (
        "servicer.inertia_kg_m2=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]", "servicer.inertia_kg_m2", "3"
    ),
    "a hull of three points": (
        "target.hull_m=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]", "target.hull_m", "4"
    ),
    "zero quaternion": ("target.attitude=[0.0, 0.0, 0.0, 0.0]", "target.attitude", "not zero"),
    "zero direction": ("thruster.direction=[0.0, 0.0, 0.0]", "thruster.direction", "not zero"),
    "indefinite inertia": (
        "servicer.inertia_kg_m2=[[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
        "servicer.inertia_kg_m2",
        "positive definite",
    ),
    "asymmetric inertia": (
        "servicer.inertia_kg_m2=[[1.0, 0.2, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]",
        "servicer.inertia_kg_m2",
        "symmetric",
    ),
    "inertia of no real body": (
        "target.inertia_kg_m2=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 3.0]]", "target.inertia_kg_m2", "real body"
    ),
    "wheels in a plane": (
        "wheels.axes=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0]]", "wheels.axes", "span"
    ),
    "wheel axes of no unit length": (
        "wheels.axes=[[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]", "wheels.axes", "unit"
    ),
    "hyperbolic orbit": ("orbit.eccentricity=1.2", "orbit.eccentricity", "less than"),
    "orbit under the ground": ("orbit.semi_major_axis_m=6e6", "orbit.semi_major_axis_m", "greater than"),
    "probability above one": ("camera.miss_probability=1.5", "camera.miss_probability", "less than or equal to 1"),
    "unknown camera": ("camera.model=thermal", "camera.model", "'geometric'"),
    "an epoch that is no date": ("epoch_utc=tomorrow", "epoch_utc", "date and time", "2026-03-20T14:46:00"),
    "an epoch with a thirteenth month": ('epoch_utc="2026-13-20T14:46:00"', "epoch_utc", "date and time"),
    "an epoch in a second 60 that was not": (
        'epoch_utc="2026-03-20T23:59:60"', "epoch_utc", "second 60 in leap seconds"
    ),
    "an epoch on the last day of a leap year that is none": ('epoch_utc="2026-366T00:00:00"', "epoch_utc", "calendar"),
    "an epoch before UTC had leap seconds": ('epoch_utc="1971-12-31T23:59:59"', "epoch_utc", "since 1972"),
    "an epoch of which the Moon is not known": ('epoch_utc="2051-01-01T00:00:00"', "epoch_utc", "from 1972 to 2050"),
    "an epoch with an offset of more than a day": (
        'epoch_utc="2026-03-20T14:46:00+24:00"', "epoch_utc", "an offset from UTC"
    ),
    "an epoch that is a number": ("epoch_utc=2026", "epoch_utc", "string"),
    "a zonal degree of one": ("effects.zonal_degree=1", "effects.zonal_degree", "0, 2"),
    "a zonal degree beyond the model": ("navigation.zonal_degree=7", "navigation.zonal_degree", "0, 2"),
    "a number for a switch": ("effects.drag=1", "effects.drag", "boolean"),
    "an unknown integrator": ("effects.integrator=euler", "effects.integrator", "'rk4'", "'rk8'"),
    "an unknown fault": ("faults.fault.kind=gremlins", "faults.fault.kind", "'none'", "'gps_outage'"),
    "air without a scale": ("atmosphere.scale_height_m=0.0", "atmosphere.scale_height_m", "greater than 0"),
    "unknown gating": ("navigation.gating=maybe", "navigation.gating", "'covariance'", "'none'"),
    "a plant too fast for any machine": ("rates.plant_hz=1001.0", "rates.plant_hz", "less than or equal to 1000"),
    "a direction of rounding errors": ("thruster.direction=[1e-9, -9e-7, 0.0]", "thruster.direction", "not zero"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_VALUES.values(), ids=BAD_VALUES.keys())
def test_a_bad_value_is_refused_with_its_key_and_what_was_expected(case: tuple[str, ...]) -> None:
    override, key, *words = case
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.load("inspection", [override])
    assert caught.value.key == key
    assert_one_line(caught.value, key, *words)
