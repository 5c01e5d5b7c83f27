"""What was simulated, in a few lines."""

from rpojax.report.sections import simulation_section
from rpojax.scenario.loading import scenario_loader


def lines(campaign, name):
    campaign.info["scenario"] = scenario_loader.load(name).model_dump()
    return dict(simulation_section.rows(campaign))


def test_vehicle_orbit_camera_target_and_phases_are_those_of_the_scenario(campaign):
    found = lines(campaign, "inspection")
    times = "\N{MULTIPLICATION SIGN}"
    assert found == {
        "Runs": f"each drawn by itself, {len(campaign.drawn)} quantities dispersed",
        "Vehicle": "30 kg, thruster of 0.03 N, 3 wheels of 0.502 N m s and 0.025 N m",
        "Orbit": "500 km above the equator's radius, inclined by 97.4 deg, eccentricity 0.001",
        "Camera": f"lens of 10 deg (full angle), 128 {times} 128 px, 1 Hz, boxes by an error model, no images, 5 % "
        "missed and 5 % false",
        "Target": f"0.5 {times} 1.6 {times} 0.6 m, 45 kg, tumbles at 1 deg/s",
        "Mission": "from 50 m behind to the station at 30 m behind; keep-out sphere of 10 m about the target",
    }


def test_phases_and_scaled_targets_are_named(campaign):
    file = scenario_loader.load("vbar_approach")
    campaign.info["scenario"] = {**file.model_dump(), "camera": {"model": "rendered", "field_of_view_deg": 12.0}}
    campaign.info["scenario"]["target"] |= {"scale": 8.0}
    found = dict(simulation_section.rows(campaign))
    assert found["Mission"].startswith("hold_100 \N{RIGHTWARDS ARROW} approach \N{RIGHTWARDS ARROW} hold_12; keep-out")
    assert found["Target"].startswith("4 \N{MULTIPLICATION SIGN} 12.8 ")
    assert found["Camera"] == "lens of 12 deg (full angle), 1 Hz, rendered images and a detector"


def test_a_folder_without_a_scenario_has_no_lines(campaign):
    campaign.info = {"name": "bare", "seed": 3}
    assert simulation_section.rows(campaign) == []


def test_places_off_the_axes_have_their_components(campaign):
    campaign.info["scenario"] = scenario_loader.load("inspection").model_dump()
    campaign.info["scenario"]["initial"]["relative_position_m"] = [1.0, -50.0, 2.5]
    campaign.info["scenario"]["formation"]["desired_position_m"] = [20.0, 0.0, 0.0]
    found = dict(simulation_section.rows(campaign))
    assert found["Mission"].startswith("from (1, -50, 2.5) m to the station at 20 m above; keep-out")


def test_beliefs_that_causes_name_have_a_line_with_their_values(campaign):
    campaign.info["scenario"] = scenario_loader.load("inspection").model_dump()
    cause = {"name": "belief", "title": "a wrong belief of navigation.bearing_bias_sigma_deg"}
    found = dict(simulation_section.rows(campaign, [cause, {"name": "wheels", "title": "wheels are saturated"}]))
    assert found["Believed"] == "bearing_bias_sigma_deg 0.1 deg"


def test_a_second_lens_and_a_lamp_are_named(campaign):
    found = lines(campaign, "final_approach")["Camera"]
    assert "lens of 20 deg (full angle) and one of 45 deg below 12 m, " in found
    assert found.endswith("a lamp to 120 m")
    assert "lamp" not in lines(campaign, "night_approach")["Camera"]  # it is off
