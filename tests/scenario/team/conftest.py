"""A team of three servicers on a relative orbit."""

from typing import Any

import pytest

from rpojax.scenario.loading import scenario_loader


@pytest.fixture
def tables() -> dict[str, Any]:
    """Tables of a valid team, free to be changed."""
    found = scenario_loader.load("safety_ellipse").model_dump()
    found["navigation"]["sharing"] = "boxes"
    found["faults"] = [{"name": "camera", "kind": "none"}]
    found["servicers"] = [
        {"name": "first"},
        {
            "name": "second",
            "initial": {"relative_position_m": [0.0, -50.0, -30.0]},
            "phases": {"inspect": {"reference": {"radial_phase_deg": 180.0}, "timeout_s": 9000.0}},
            "faults": {"camera": {"kind": "camera_blackout", "start_s": 100.0}},
        },
        {"name": "third", "initial": {"relative_position_m": [25.0, 0.0, 0.0]}, "servicer": {"mass_kg": 20.0}},
    ]
    return found
