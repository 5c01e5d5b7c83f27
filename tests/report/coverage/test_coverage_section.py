"""Inspection coverage in the report: shares of area and runs, the parts that were seen least, and the picture."""

import json
from typing import Any

import cv2
import numpy as np
import pytest
from report_page_parser import page_text, rendered_page

from rpojax.report.figures.png_export import png_bytes
from rpojax.report.sections import coverage_section
from rpojax.report.sections.coverage_section import surface_picture
from rpojax.vision.surface.facets import make_facets
from tests import surface_meshes

_SEEN_RUNS = {"+x": 40, "+y": 10, "-x": 0, "-y": 40, "+z": 40}
"""Of 40 runs; the side -z is never lit."""


@pytest.fixture
def covered(campaign: Any) -> Any:
    """A campaign of 40 runs whose target is a cube of 1 m with one facet a side."""
    facets = make_facets(surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), 1.0)
    assert len(facets.areas) == 6
    lit, seen = np.zeros((40, 6), np.int32), np.zeros((40, 6), np.int32)
    for side, count in _SEEN_RUNS.items():
        facet = facet_of(facets.normals, side)
        lit[:, facet], seen[:count, facet] = 20, 3
    campaign.surface = facets.arrays()
    campaign.coverage = {"lit_samples": lit, "seen_samples": seen}
    campaign.metrics["surface_seen_fraction"] = np.linspace(0.6, 0.8, 40)
    campaign.metrics["time_to_90_percent_seen_s"] = np.full(40, np.nan)
    return campaign


def facet_of(normals: np.ndarray, side: str) -> int:
    axis = np.eye(3)["xyz".index(side[1])] * (1.0 if side[0] == "+" else -1.0)
    return int(np.argmax(normals @ axis))


def test_shares_of_area_and_least_seen_facets(covered: Any) -> None:
    found = coverage_section.content(covered)
    assert found is not None
    assert found["facets"] == 6
    assert found["area_m2"] == pytest.approx(6.0)
    assert found["lit_in_no_run"] == pytest.approx(1.0 / 6.0)
    assert found["lit_but_seen_in_no_run"] == pytest.approx(1.0 / 6.0)
    first, second = found["least_seen"][:2]
    assert (first["normal"], first["lit_runs"], first["seen_runs"]) == ([-1.0, 0.0, 0.0], 40, 0)
    assert (second["normal"], second["seen_runs"]) == ([0.0, 1.0, 0.0], 10)
    assert len(found["least_seen"]) == 5


def test_page_shows_coverage_with_its_picture(covered: Any) -> None:
    page = rendered_page(covered)
    text = page_text(page)
    assert "Seen area over lit area 0.7000 in the median run, 0.6000 to 0.8000, in 40 runs" in text
    assert "Time to see 90 % of it" not in text
    assert "Area that was lit, but seen in no run 16.7 %" in text
    images = [attributes for tag, attributes in page.tags if tag == "img" and "six sides" in str(attributes["alt"])]
    assert len(images) == 1
    content = json.loads((covered.directory / "report.json").read_text())
    assert content["coverage"]["facets"] == 6


def test_page_without_coverage_does_not_mention_it(campaign: Any) -> None:
    assert "Inspection coverage" not in page_text(rendered_page(campaign))
    assert json.loads((campaign.directory / "report.json").read_text())["coverage"] is None
    assert not (campaign.directory / "figures" / coverage_section.FIGURE_NAME).exists()


def test_picture_has_the_colour_of_each_side(covered: Any) -> None:
    normals = covered.surface["normals"]
    values = np.full(6, np.nan)
    for side, count in _SEEN_RUNS.items():
        values[facet_of(normals, side)] = count / 40
    picture = cv2.imdecode(
        np.frombuffer(png_bytes(surface_picture(covered.surface, values, 1.0, "share", "a cube")), np.uint8),
        cv2.IMREAD_COLOR_RGB,
    )
    # Each of six equal sides takes the same part of the picture: yellow for three, dark violet, blue, grey.
    ends = {"yellow": (253, 231, 37), "violet": (68, 1, 84), "blue": (59, 82, 139), "grey": (138, 151, 168)}
    shares = {name: np.mean(np.all(np.abs(picture.astype(int) - colour) <= 3, axis=2)) for name, colour in ends.items()}
    assert shares["yellow"] == pytest.approx(3.0 * shares["grey"], rel=0.05)
    assert shares["violet"] == pytest.approx(shares["grey"], rel=0.05)
    assert shares["blue"] == pytest.approx(shares["grey"], rel=0.05)
    assert shares["grey"] > 0.05
