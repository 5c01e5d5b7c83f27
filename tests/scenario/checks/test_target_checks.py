"""Packaged pictures, statistics and surface are those of the packaged target, and refused for another one."""

import json
from pathlib import Path

import pytest
from scenario_error_assertions import assert_one_line

import rpojax
from rpojax.cli import main
from rpojax.errors import ScenarioError
from rpojax.scenario.trained import packaged_hull
from rpojax.scenario.warnings.mission_warnings import mission_warnings

HULL = rpojax.load("inspection").target.hull_m
CUBE = [[x, y, z] for x in (-0.4, 0.4) for y in (-0.4, 0.4) for z in (-0.5, 0.5)]


def scaled(factor: float) -> list[list[float]]:
    """The packaged hull, larger."""
    return [[factor * value for value in point] for point in HULL]


def overrides(hull: object, *others: str) -> list[str]:
    """Overrides of a scenario with a hull."""
    return [f"target.hull_m={json.dumps(hull)}", *others]


@pytest.mark.parametrize("hull", [CUBE, scaled(1.2), scaled(0.5)], ids=["cube", "larger", "smaller"])
@pytest.mark.parametrize(
    ("settings", "key"),
    [
        (["camera.model=rendered"], "imaging.field"),
        (["camera.model=statistical"], "imaging.statistics"),
        (["coverage.enabled=true", "coverage.surface=packaged"], "coverage.surface"),
    ],
)
def test_what_is_of_the_packaged_target_is_refused_for_another_hull(
    hull: object, settings: list[str], key: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        rpojax.load("inspection", overrides(hull, *settings))
    assert caught.value.key == key
    assert_one_line(caught.value, key, "packaged", "target.hull_m")


def test_files_of_the_users_own_and_other_models_are_accepted(tmp_path: Path) -> None:
    own = tmp_path / "own.safetensors"
    own.write_bytes(b"a field of one's own")
    for settings in (
        [],
        ["coverage.enabled=true", "coverage.surface=hull"],
        ["camera.model=rendered", f"imaging.field={json.dumps(str(own))}"],
        ["camera.model=statistical", f"imaging.statistics={json.dumps(str(own))}"],
    ):
        assert rpojax.load("inspection", overrides(CUBE, *settings)).target.hull_m == CUBE


def test_the_packaged_hull_in_any_order_and_at_any_scale_has_the_packaged_pictures() -> None:
    for changes in (overrides(HULL[::-1]), ["target.scale=0.5"]):
        for model in ("rendered", "statistical"):
            file = rpojax.load("inspection", [*changes, f"camera.model={model}"])
            assert not any(each.startswith("imaging.") for each in mission_warnings(file))


def test_a_hull_of_nearly_the_same_size_is_warned_of() -> None:
    # 1.6 m times 0.02 is within a twentieth of 1.6 m at either end.
    file = rpojax.load("inspection", overrides(scaled(1.02), "camera.model=rendered", "coverage.enabled=true"))
    found = [each.partition(":")[0] for each in mission_warnings(file)]
    assert {"imaging.field", "coverage.surface"} <= set(found)
    with pytest.raises(ScenarioError):  # statistics are fitted to one hull
        rpojax.load("inspection", overrides(scaled(1.02), "camera.model=statistical"))
    assert not [each for each in mission_warnings(rpojax.load("inspection")) if "packaged" in each]


def test_a_shifted_hull_is_not_like_the_packaged_one() -> None:
    shifted = [[x, y + 0.2, z] for x, y, z in HULL]
    assert not packaged_hull.is_like_packaged(shifted)
    assert packaged_hull.is_like_packaged(HULL)


def test_statistics_are_not_fitted_to_pictures_of_another_target(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--out", str(tmp_path / "own.safetensors"), "--set", overrides(CUBE)[0]]
    assert main.main(["calibrate-camera-model", "inspection", *words]) == 2
    assert capsys.readouterr().err.startswith("rpojax: error: imaging.field: found 'packaged'")
