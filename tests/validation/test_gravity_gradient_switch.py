"""The gravity-gradient torque is recognised from keys, descriptions and logged torques."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.validation import replay
from experiments.validation.gravity_gradient_switch import has_gravity_gradient
from experiments.validation.reference_file import read_reference, validate
from experiments.validation.replay import ReplayOptions

REFERENCE = Path(__file__).parent / "references" / "f_gravity_gradient.npz"


@pytest.mark.parametrize(
    ("acts", "meta"),
    [
        (True, {"torque": "gravity gradient of a point mass"}),
        (True, {"torque": "tau_B = 3 mu / r^5 * r_B x (I r_B); logged late, compare loosely"}),
        (True, {"gravity": "J2 + gravity-gradient torque (point-mass term)", "note": "no drag"}),
        (True, {"note": "no drag, gravity gradient on"}),
        (True, {"note": "the gravity gradient is not negligible"}),
        (True, {"effects": ["J2", "gravity_gradient"]}),
        (True, {"gravity_gradient": True, "note": "no gravity gradient in the first half"}),
        (True, {"case": "wheels_with_gravity_gradient"}),
        (False, {"note": "no gravity gradient"}),
        (False, {"note": "gravity-gradient torque not modelled"}),
        (False, {"note": "gravity gradient: off"}),
        (False, {"note": "point mass, without drag or gravity gradient"}),
        (False, {"note": "no drag, sunlight or gravity gradient"}),
        (False, {"note": "gravity gradient (off)"}),
        (False, {"note": "gravity-gradient-free orbit"}),
        (True, {"note": "J2, gravity gradient, no drag"}),
        (True, {"note": "gravity gradient (not logged exactly at the sample)"}),
        (False, {"note": "free of drag and gravity gradient"}),
        (False, {"note": "not modelled: drag, gravity gradient"}),
        (False, {"note": "gravity gradient torque is disabled", "case": "f_gravity_gradient"}),
        (False, {"case": "f_no_gravity_gradient"}),
        (False, {"gravity_gradient": "off"}),
        (False, {"effects": {"gravity_gradient": False}}),
        (False, {"no_gravity_gradient": True}),
        (False, {"case": "f_low_orbit"}),
        (False, {}),
    ],
)
def test_gravity_gradient_is_recognised_from_a_key_or_the_description(acts: bool, meta: dict[str, Any]) -> None:
    arrays = read_reference(REFERENCE).arrays
    described = validate("described", {**arrays, "meta_json": np.array(json.dumps(meta))})
    assert has_gravity_gradient(described) is acts
    assert [has_gravity_gradient(described, wish) for wish in ("on", "off")] == [True, False]


def test_gravity_gradient_is_recognised_from_a_logged_torque_unless_an_array_switches_it_off() -> None:
    arrays = read_reference(REFERENCE).arrays
    logged = {**arrays, "torque_gg": np.zeros_like(arrays["r"])}
    assert has_gravity_gradient(validate("logged", logged))
    assert not has_gravity_gradient(validate("off", {**logged, "gravity_gradient": np.array(False)}))
    without = replay.replay(validate("off", logged), ReplayOptions(gravity_gradient="off"))
    assert without.attitude_error_rad is not None and without.attitude_error_rad > 1e-10
