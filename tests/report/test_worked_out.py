"""Parts of a report that numbers do not allow are left out with a note; damaged folders are still refused."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from synthetic_campaign_results import SyntheticCampaign

from rpojax.analysis.statistics import dependence
from rpojax.analysis.statistics.dependence import rank_inputs
from rpojax.errors import ResultError
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.left_out_parts import Notes
from rpojax.report.page.report_json import report_content
from rpojax.report.sections import sensitivity_section


def test_a_part_that_fails_is_made_without_numbers_and_noted(
    campaign: SyntheticCampaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    def content(results: CampaignResults) -> list[float]:
        return [1.0 / math.floor(0.5) for values in results.metrics.values() if np.isfinite(values).any()]

    monkeypatch.setattr(sensitivity_section, "content", content)
    notes = Notes()
    found = report_content(campaign, [], notes)
    assert found["sensitivity"] == []
    assert found["metrics"]["min_range_m"]["p50"] is not None
    [sentence] = notes.sentences
    assert sentence.startswith("Dependence on the dispersed inputs could not be worked out")
    assert found["limits"][0] == sentence


def test_errors_of_the_package_are_not_notes(campaign: SyntheticCampaign) -> None:
    def refused(_: CampaignResults) -> None:
        raise ResultError("a damaged folder")

    with pytest.raises(ResultError):
        Notes().part("Anything", refused, campaign)


@pytest.mark.parametrize("scale", [1e-200, 1e-300, 1.0, 1e154, 1e200, 1e307])
def test_dependence_is_the_same_at_any_scale(scale: float) -> None:
    rng = np.random.default_rng(3)
    inputs = {"a": rng.normal(size=40), "b": rng.normal(size=40)}
    metric = inputs["a"] ** 2 + 0.1 * inputs["b"]
    expected = rank_inputs(inputs, metric)
    found = rank_inputs({name: scale * values for name, values in inputs.items()}, metric)
    for one, other in zip(found.inputs, expected.inputs, strict=True):
        assert one.name == other.name
        assert one.hsic == pytest.approx(other.hsic, rel=1e-5)
        assert one.spearman == other.spearman


def test_ordinary_numbers_are_not_scaled() -> None:
    values = np.array([1.0, 2.0, 4.0])
    scaled: Callable[[np.ndarray], np.ndarray] = dependence._in_range
    assert scaled(values) is values
