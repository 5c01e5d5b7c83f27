"""A campaign with inspection coverage: stored maps and facets, and the same numbers again by rerun and resume."""

from pathlib import Path

import numpy as np
import pytest
from named_loops import name_loop

from rpojax.campaign.rerun import rerun
from rpojax.campaign.run_and_resume import resume_campaign, run_campaign
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError
from rpojax.scenario.loading import scenario_loader


@pytest.fixture(scope="module")
def covered(tmp_path_factory: pytest.TempPathFactory, programs: None) -> Campaign:
    """Two runs of 60 s in blocks of their own, whose target is the hull of the scenario."""
    file = scenario_loader.load(
        "inspection",
        [
            *("duration_s=60", "coverage.enabled=true", "coverage.surface=hull"),
            *("coverage.facet_size_m=0.2", "coverage.resolution_limit_m_px=0.1", "coverage.spacing_s=1"),
        ],
    )
    name_loop("coverage", file)
    return run_campaign(file, 2, tmp_path_factory.mktemp("covered") / "runs", block_size=1, histories=[0])


def test_maps_agree_with_facets_and_metrics(covered: Campaign) -> None:
    lit, seen = (covered.coverage[name] for name in ("lit_samples", "seen_samples"))
    areas = covered.surface["areas"]
    assert lit.shape == seen.shape == (2, len(areas))
    assert np.all(seen <= lit)
    assert lit.max() <= 60
    fraction = [areas[row > 0].sum() for row in seen] / np.array([areas[row > 0].sum() for row in lit])
    np.testing.assert_allclose(covered.metrics["surface_seen_fraction"], fraction, rtol=1e-12)
    assert np.all(fraction > 0.05)
    assert {"q_TN", "q_BN", "r_TN_N"} <= set(covered.history(0))


def test_rerun_and_resume_repeat_coverage_to_the_last_bit(covered: Campaign, tmp_path: Path) -> None:
    repeated = rerun(covered, 1, tmp_path / "rerun")
    assert repeated.differences == {}
    maps, again = covered.coverage, repeated.campaign.coverage
    for name, values in maps.items():
        np.testing.assert_array_equal(again[name][0], values[1])
    facets, results = covered.surface, covered.directory / "results.zarr"
    lost = (results / "surface" / "areas" / "c" / "0", results / "coverage" / "lit_samples" / "c" / "1" / "0")
    for path in lost:
        path.unlink()
    (results / "surface" / "zarr.json").unlink()  # as where a process was killed while it wrote the facets
    with pytest.raises(ResultError, match="surface: missing"):
        _ = Campaign(covered.directory).surface
    resumed = resume_campaign(covered.directory)
    assert all(path.is_file() for path in lost)
    for name, values in resumed.coverage.items():
        np.testing.assert_array_equal(values, maps[name])
    for name, values in resumed.surface.items():
        np.testing.assert_array_equal(values, facets[name])


def test_changed_facets_are_refused(covered: Campaign) -> None:
    path = next((covered.directory / "results.zarr" / "surface" / "areas" / "c").rglob("0"))
    original = path.read_bytes()
    path.write_bytes(bytes(len(original)))
    with pytest.raises(ResultError, match="surface: found other values"):
        _ = covered.surface
    path.write_bytes(original)
    assert covered.surface["areas"].sum() > 1.0
