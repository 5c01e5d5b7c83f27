"""Campaigns that end when they are decided: planned looks, records, and the same end after an interrupt."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from rpojax.campaign import sequential_looks
from rpojax.campaign.execution.executor import LocalExecutor
from rpojax.campaign.options.campaign_options import CampaignOptions, Shard
from rpojax.campaign.run_and_resume import Execution, resume_campaign, run_campaign, start_campaign
from rpojax.campaign.status import status
from rpojax.campaign.storage import look_records
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError, RpojaxError
from rpojax.report.page.html_report import write_report
from rpojax.report.sections import requirement_verdict_section
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

ONE_DEVICE = jax.devices()[:1]
WIDE, TIGHT, IMPOSSIBLE = 1000.0, 1e-6, 0.5
"""Limits of the formation error that every run keeps, that none keeps, and shares that few runs decide."""


def judged(limit: float, probability: float = 0.6, **changes: Any) -> ScenarioFile:
    """A short mission with one requirement on the formation error, which a handful of runs decides."""
    file = scenario_loader.load("inspection", ["duration_s=400"])
    requirement = {
        "metric": "formation_error_rms_m",
        "bound": "at most",
        "limit": limit,
        "probability": probability,
        "consumer_risk": 0.2,
        **changes,
    }
    return scenario_loader.validate({**file.model_dump(mode="json"), "requirements": [requirement]})


def simulate(file: ScenarioFile, out: Path, **changes: Any) -> Campaign:
    """At most sixteen runs in blocks of two, with a look after each."""
    return run_campaign(
        file, 16, out, 3, until_decided=True, block_size=2, devices=ONE_DEVICE, progress=False, histories=[0], **changes
    )


@pytest.fixture(scope="module")
def verified(programs: None, tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Campaign of which no run violates the requirement."""
    return simulate(judged(WIDE), tmp_path_factory.mktemp("sequential") / "runs")


def test_a_campaign_ends_at_the_look_that_decides(verified: Campaign) -> None:
    plan = verified.configuration.options.plan
    assert plan is not None
    assert plan.looks == tuple(range(2, 17, 2))
    assert verified.looks[-1].is_decided
    assert not any(look.is_decided for look in verified.looks[:-1])
    ended = verified.looks[-1].runs
    assert 0 < ended < 16
    assert verified.run_ids.tolist() == list(range(ended))
    assert (verified.info["runs"], verified.missing_blocks(), verified.has_ended) == (ended, [], True)
    stated = json.loads((verified.directory / "campaign.json").read_text())["sequential"]
    assert stated["looks"] == list(plan.looks)
    assert stated["bounds"][0]["allowed"][len(verified.looks) - 1] == 0


def test_status_and_report_state_the_sequential_verdict(verified: Campaign) -> None:
    ended = verified.looks[-1].runs
    found = status(verified.directory)
    assert found["runs"]["requested"] == ended
    assert found["runs"]["missing"] == 0
    assert found["sequential"]["decided_at"] == ended
    assert [each["verdict"] for each in found["sequential"]["requirements"]] == ["verified"]
    [entry] = requirement_verdict_section.content(verified, 0)
    assert entry["verdict_text"] == f"verified at look {len(verified.looks)} of 8, {ended} runs"
    assert (entry["sequential"]["decided_at_runs"], entry["sequential"]["at_most"]) == (ended, 16)
    # A fixed number of runs verifies with fewer of them, of which a look spends only its part of the risk.
    assert entry["risk_reached"] > 0.6**ended
    page = write_report(verified, progress=False, film=False).read_text()
    assert "planned with 8 looks and at most 16 runs" in page
    assert "A verdict holds for a number of runs that was fixed beforehand" not in page


class Interrupted(LocalExecutor):
    """Executor of a process that is killed after some blocks."""

    def run_blocks(self, blocks: Sequence[int], on_progress: Any) -> dict[int, str]:
        if 1 in blocks:
            raise KeyboardInterrupt
        return super().run_blocks(blocks, on_progress)


def test_killed_and_resumed_ends_as_uninterrupted(
    verified: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "runs"
    file = judged(WIDE)
    from rpojax.campaign import run_and_resume

    with monkeypatch.context() as patch:
        patch.setattr(run_and_resume, "LocalExecutor", Interrupted)
        with pytest.raises(KeyboardInterrupt):
            simulate(file, out)
    assert len(Campaign(out).looks) == 1
    # Killed between the last block of a look and its record, which the resume makes.
    (out / look_records.FILE_NAME).unlink()
    resumed = resume_campaign(out, progress=False)
    assert resumed.looks == verified.looks
    for name, values in verified.metrics.items():
        np.testing.assert_array_equal(resumed.metrics[name], values, err_msg=name)
    names = [
        sorted(
            str(path.relative_to(each.directory))
            for path in each.directory.rglob("*")
            if "report" not in path.name and "figures" not in path.parts
        )
        for each in (resumed, verified)
    ]
    assert names[0] == names[1]
    before = (out / look_records.FILE_NAME).read_bytes()
    resume_campaign(out, progress=False)
    assert (out / look_records.FILE_NAME).read_bytes() == before


def test_a_requirement_that_no_run_keeps_is_refuted(programs: None, tmp_path: Path) -> None:
    found = simulate(judged(TIGHT), tmp_path / "runs")
    assert found.looks[-1].requirements[0].verdict == "refuted"
    assert found.configuration.runs < 16
    [entry] = requirement_verdict_section.content(found, 0)
    assert entry["verdict"] == "not verified"


def test_a_campaign_ends_undecided_at_its_last_look(verified: Campaign, tmp_path: Path) -> None:
    found = simulate(judged(WIDE, 0.99), tmp_path / "runs")
    assert (len(found.run_ids), len(found.looks), found.has_ended) == (16, 8, True)
    [entry] = requirement_verdict_section.content(found, 0)
    assert entry["verdict"] == "undecided by all runs of the plan"
    assert entry["more_runs"] is None


def test_changed_looks_are_refused(verified: Campaign, tmp_path: Path) -> None:
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(verified.directory, copy)
    path = copy / look_records.FILE_NAME
    path.write_text(path.read_text().replace('"open"', '"verified"', 1))
    with pytest.raises(ResultError, match=r"looks\.json"):
        Campaign(copy)


def test_plans_that_decide_nothing_are_refused(tmp_path: Path) -> None:
    file = judged(WIDE)
    options = CampaignOptions(runs=16, until_decided=True)
    nothing = file.model_copy(update={"requirements": []})
    with pytest.raises(RpojaxError, match="found no requirements"):
        start_campaign(nothing, options, tmp_path / "runs")
    dependent = scenario_loader.validate({**file.model_dump(mode="json"), "design": {"kind": "latin_hypercube"}})
    with pytest.raises(RpojaxError, match="expected independent runs"):
        start_campaign(dependent, options, tmp_path / "runs")
    with pytest.raises(RpojaxError, match="shard"):
        start_campaign(file, options, tmp_path / "runs", Execution(shard=Shard(1, 2)))
    with pytest.raises(RpojaxError, match="at_most"):
        sequential_looks.most_runs(judged(WIDE, 1.0 - 1e-7))
    assert sequential_looks.most_runs(judged(WIDE, 0.99, consumer_risk=0.1)) == 1000
