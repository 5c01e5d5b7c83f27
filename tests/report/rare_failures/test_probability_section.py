"""The campaign's report shows estimates of its folder, and the command for requirements that are too rare for runs."""

import re
from pathlib import Path
from typing import Any

import pytest
from probability_estimates import ESTIMATE
from synthetic_campaign_results import SyntheticCampaign

from rpojax.analysis.reliability.simulated_failures.estimate_folder import EstimateFolder
from rpojax.analysis.statistics import rare_requirements
from rpojax.errors import ResultError
from rpojax.report import rare_failures
from rpojax.report.page import page_templates, probability_page


def section(entries: list[dict[str, Any]]) -> str:
    """The section of the campaign's report."""
    return page_templates.render(
        "parts/rare_failures.html", {}, {"rare_failures": rare_failures.section_values(entries)}
    )


def with_requirement(campaign: SyntheticCampaign, probability: float) -> None:
    """Gives the campaign a requirement on the least range."""
    requirement = {"metric": "min_range_m", "bound": "at least", "limit": 10.0}
    campaign.info["scenario"]["requirements"] = [{**requirement, "probability": probability, "consumer_risk": 0.1}]


def write(campaign: SyntheticCampaign) -> Path:
    """Writes an estimate into the campaign's folder; the path of its result."""
    folder = EstimateFolder(campaign.directory / "probability" / "min_range_m")
    (campaign.directory / "probability").mkdir(parents=True)
    folder.begin({"seed": 0}, force=False)
    folder.write("probability.json", ESTIMATE)
    return folder.directory / "probability.json"


def test_a_rare_requirement_gets_its_command_and_the_runs_that_plain_sampling_needs(
    campaign: SyntheticCampaign,
) -> None:
    with_requirement(campaign, 0.99999)
    (entry,) = rare_failures.content(campaign)
    # (1 - 1e-5)^n <= 0.1 for n >= 230258.
    assert entry["plain_runs"] == 230258
    text = section([entry])
    assert "230,258 runs" in text
    assert "--requirement min_range_m --out" in text


def test_a_requirement_that_plain_runs_verify_gets_none(campaign: SyntheticCampaign) -> None:
    with_requirement(campaign, 0.99)
    assert rare_failures.content(campaign) == []
    assert rare_failures.section_values([]) is None


def test_an_estimate_takes_the_place_of_the_command(campaign: SyntheticCampaign) -> None:
    with_requirement(campaign, 0.99999)
    write(campaign)
    (entry,) = rare_failures.content(campaign)
    text = section([entry])
    for part in ("1.2e-05", "the requirement is met", "31.2", "--run-id 7", "13,000,000 runs", "another scenario"):
        assert part in text


def test_the_headline_stands_once_in_the_section_and_on_the_page(campaign: SyntheticCampaign, tmp_path: Path) -> None:
    with_requirement(campaign, 0.99999)
    write(campaign)
    page = probability_page.write_page(ESTIMATE, tmp_path).read_text()
    for text in (section(rare_failures.content(campaign)), page):
        assert text.count("min_range_m below 10 m, or undefined, as in a run that ended early") == 1


def test_a_spoilt_estimate_is_refused_in_one_line(campaign: SyntheticCampaign) -> None:
    path = write(campaign)
    path.write_text(path.read_text().replace("1.2e-05", "1.2e-09"))
    with pytest.raises(ResultError, match="does not match its digest") as error:
        rare_failures.content(campaign)
    assert "\n" not in str(error.value)


def test_the_page_of_an_estimate_is_self_contained(tmp_path: Path) -> None:
    page = probability_page.write_page({**ESTIMATE, "trusted": False}, tmp_path).read_text()
    assert "NOT trusted" in page
    assert re.findall(r'(?:src|href)="(?!#)[^"]*"', page) == []


def test_what_counts_as_rare() -> None:
    assert rare_requirements.is_rare(0.9995)
    assert not rare_requirements.is_rare(0.999)
