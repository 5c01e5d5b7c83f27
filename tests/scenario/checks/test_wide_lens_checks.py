"""Tests of the checks of the second lens, and of the records that a scenario with one becomes."""

import pytest

import rpojax
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.scenario import params
from rpojax.scenario.params import leaf_path_and_factor
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.trained import fitted_camera, trained_files
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.target_size import small_box_warnings
from tests.scenario_error_assertions import assert_one_line

LENS = ["wide_lens.field_of_view_deg=45", "wide_lens.switch_range_m=32", "wide_lens.return_range_m=36"]


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        (["wide_lens.field_of_view_deg=10"], "wide_lens.field_of_view_deg", "more than camera.field_of_view_deg = 10"),
        (["wide_lens.return_range_m=32"], "wide_lens.return_range_m", "more than switch_range_m = 32"),
        (["wide_lens.switch_range_m=30"], "wide_lens.switch_range_m", "more than 30"),
        (["coverage.enabled=true"], "coverage.enabled", "false with [wide_lens]"),
    ],
)
def test_a_lens_of_no_use_is_refused(changes: list[str], key: str, words: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("inspection", [*LENS, *changes])
    assert_one_line(refused.value, key, words)


def test_a_team_has_one_lens() -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("cooperative_inspection", LENS)
    assert_one_line(refused.value, "wide_lens", "team")


def test_a_linear_covariance_has_one_lens() -> None:
    with pytest.raises(
        RpojaxError, match="wide_lens: found 'a second lens', expected one lens for a linear covariance"
    ):
        rpojax.linear_covariance(rpojax.load("inspection", LENS))


@pytest.mark.parametrize("named", [[], ["wide_lens.statistics=packaged"]])
def test_packaged_statistics_of_another_lens_are_refused(named: list[str]) -> None:
    file = rpojax.load("inspection", [*LENS, "camera.model=statistical", *named])
    assert "wide_lens.statistics" in trained_files.required_digests(file.model_dump())
    with pytest.raises(ScenarioError) as refused:
        fitted_camera.wide_statistics_for_model(file.model_dump())
    assert_one_line(refused.value, "wide_lens.statistics", "camera.field_of_view_deg: found 45")


def test_flight_software_has_the_nominal_lens_and_a_dispersion_the_true_one() -> None:
    file = rpojax.load("inspection", [*LENS, "wide_lens.edge_noise_px=2", "wide_lens.believed_edge_noise_px=3"])
    made = params.build_params(file.model_dump(), file.camera.width_px, file.camera.height_px)
    assert made.wide_lens is not None
    assert made.flight.wide_lens is not None
    assert made.wide_lens.edge_noise is not None
    assert made.flight.wide_lens.edge_noise is not None
    assert (float(made.wide_lens.edge_noise), float(made.flight.wide_lens.edge_noise)) == (2.0, 3.0)
    assert made.wide_lens.misalignment.tolist() == [0.0, 0.0, 0.0]
    alone = rpojax.load("inspection", ["camera.field_of_view_deg=45"])
    expected = params.build_params(alone.model_dump(), file.camera.width_px, file.camera.height_px)
    assert float(made.flight.wide_lens.focal_px) == float(expected.flight.vehicle.focal_px)
    assert leaf_path_and_factor("wide_lens.field_of_view_deg")[0] == ("wide_lens", "field_of_view")
    assert leaf_path_and_factor("wide_lens.switch_range_m")[0] == ("flight", "wide_lens", "switch_range")


def test_boxes_at_the_station_are_judged_through_the_lens_in_use() -> None:
    def cut(*changes: str) -> list[str]:
        near = ["formation.desired_position_m=[0.0, -5.0, 0.0]", "limits.keep_out_m=3", "camera.field_of_view_deg=10"]
        file = rpojax.load("inspection", [*near, *changes])
        return [line for line in small_box_warnings(file, DispersedReach(file)) if "does not fit" in line]

    assert cut()
    assert cut(*LENS) == []


def test_the_digest_depends_on_the_lens_and_not_on_its_defaults() -> None:
    digest = scenario_digest(rpojax.load("inspection", LENS))
    assert digest != scenario_digest(rpojax.load("inspection"))
    assert digest == scenario_digest(rpojax.load("inspection", [*LENS, "wide_lens.misalignment_deg=[0.0, 0.0, 0.0]"]))
    assert digest != scenario_digest(rpojax.load("inspection", [*LENS, "wide_lens.switch_range_m=31"]))
