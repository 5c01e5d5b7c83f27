"""Options of a campaign: the same record from the command line and from Python, checked where it is made."""

from typing import Any, get_type_hints

import pytest

from rpojax.campaign import run_and_resume
from rpojax.campaign.options.campaign_options import CampaignOptions, FurtherOptions
from rpojax.campaign.options.history_retention import Retention
from rpojax.cli import main
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile


class StartedError(Exception):
    """Raised in place of a campaign, with its options."""


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> None:
    """A campaign does not start, but raises its options."""

    def start(file: ScenarioFile, options: CampaignOptions, *_: Any, **__: Any) -> None:
        raise StartedError(options)

    monkeypatch.setattr(run_and_resume, "start_campaign", start)


def options_of_command(*words: object) -> CampaignOptions:
    """Options of the campaign that a command line would start."""
    with pytest.raises(StartedError) as caught:
        main.main(["campaign", "inspection", "--out", "runs", "--no-report", *map(str, words)])
    return caught.value.args[0]


def options_of_call(file: ScenarioFile, **keywords: Any) -> CampaignOptions:
    """Options of the campaign that `run_campaign` would start."""
    with pytest.raises(StartedError) as caught:
        run_and_resume.run_campaign(file, out="runs", progress=False, **keywords)
    return caught.value.args[0]


@pytest.mark.usefixtures("started")
def test_command_line_and_python_give_the_same_record(mission: ScenarioFile) -> None:
    assert options_of_command("--runs", 3) == options_of_call(mission, runs=3) == CampaignOptions(3)
    words = ("--seed", 5, "--block-size", 2, "--histories", "1+failures", "--history-channels", "range_m,nees")
    kept = Retention("1+failures", ("range_m", "nees"), 10)
    found = options_of_command("--runs", 4, *words, "--history-every", 10)
    assert found == options_of_call(mission, runs=4, seed=5, block_size=2, histories=kept)
    assert found == CampaignOptions(4, 5, block_size=2, histories=kept)


@pytest.mark.usefixtures("started")
def test_python_sets_every_option(mission: ScenarioFile) -> None:
    further = {"first_run": 2, "block_size": 3, "run_range": RunRange(0, 9), "report": True, "until_decided": False}
    assert further.keys() == get_type_hints(FurtherOptions).keys()
    found = options_of_call(mission, runs=4, seed=5, histories=[2, 3], **further)
    assert found == CampaignOptions(runs=4, seed=5, histories=Retention("2,3,"), **further)
    # The plan of looks is made of the others.
    assert {*further, "runs", "seed", "histories", "plan"} == CampaignOptions.__dataclass_fields__.keys()


@pytest.mark.parametrize(
    ("keywords", "argument"),
    [
        ({"runs": 0}, "runs"),
        ({"runs": 1, "seed": -1}, "seed"),
        ({"runs": 1, "first_run": -1}, "first_run"),
        ({"runs": 1, "block_size": 0}, "block_size"),
        ({"runs": 3, "histories": Retention("3,")}, "histories"),
    ],
)
def test_an_option_out_of_range_is_named(keywords: dict[str, Any], argument: str) -> None:
    with pytest.raises(RpojaxError, match=f"^{argument}: found .*expected") as caught:
        CampaignOptions(**keywords)
    assert caught.value.arguments == (argument,)


def test_the_command_line_names_the_option(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["run", "inspection", "--run-id", "-1", "--out", "runs"]) == main.Status.BAD_INPUT
    expected = "rpojax: error: --run-id: found -1, expected a whole number from 0 to 2147483646\n"
    assert capsys.readouterr().err == expected
