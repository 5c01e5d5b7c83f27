"""A filter of another layout, and the page's look at the picture, fly in campaigns; memory of one's own alone."""

import re
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from experiment_modules import load_experiment

import rpojax
from rpojax.campaign.run_and_resume import run_campaign
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError
from rpojax.flight import stage_use
from rpojax.flight.stages import Stages

PAGE = Path(__file__).parents[2] / "docs" / "how_to" / "flight_software.md"


def of_page(word: str) -> Stages:
    """Stages of the example that contains a word."""
    [block] = [
        each for each in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S) if word in each
    ]
    names: dict[str, Any] = {"__name__": "example"}
    exec(compile(block, PAGE.name, "exec"), names)
    return names["stages"]


def fly(tmp_path: Path, stages: Stages, runs: int, *overrides: str) -> Campaign:
    file = rpojax.load("inspection", overrides)
    # As for users: the tests of the package forbid implicit promotions.
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        return run_campaign(file, runs, tmp_path / "out", stages=stages, histories=[0], progress=False)


@pytest.mark.slow
def test_a_filter_of_another_layout_flies_the_whole_mission(tmp_path: Path) -> None:
    campaign = fly(tmp_path, load_experiment("one_stack/hill_frame_filter.py").STAGES, 8)
    assert set(campaign.outcomes) == {"completed"}
    assert np.max(campaign.metrics["nav_relative_position_error_rms_m"]) < 1.5
    assert np.min(campaign.metrics["sigma3_coverage"]) > 0.8
    assert np.max(campaign.metrics["formation_error_rms_m"]) < 2.0


@pytest.mark.slow
def test_a_replaced_update_sees_the_picture_of_the_rendered_loop(tmp_path: Path) -> None:
    campaign = fly(tmp_path, of_page("centre_of_light"), 2, "duration_s=100", "camera.model=rendered")
    history = campaign.history(0)
    seen = history["box_accepted"].astype(bool)
    assert seen.mean() > 0.5
    # The centre of light lies towards the Sun from that of the box, by a part of the target's size.
    error = np.linalg.norm(history["relative_error_H"][seen], axis=1)
    assert error.max() < 20.0


def test_a_stage_that_asks_for_a_picture_is_refused_without_a_rendered_camera() -> None:
    with pytest.raises(RpojaxError, match="found one with the argument `picture`, expected one without it"):
        stage_use.check_picture(Stages(orbit_update=lambda picture, estimate: estimate), "geometric")


def test_memory_of_ones_own_goes_in_and_out_of_a_stage() -> None:
    stages = Stages(
        own_memory=lambda: {"updates": 0}, formation_law=lambda deviation, own: deviation[:3] * own["updates"]
    )
    own = stages.initial_memory(params=None, estimate=None, attitude=None, camera=None)
    assert isinstance(own["updates"], jnp.ndarray)
    arguments = {"gain": jnp.zeros((3, 6)), "deviation": jnp.ones(6), "estimate": None, "time": jnp.zeros(())}
    np.testing.assert_array_equal(stages.call("formation_law", {"updates": 2.0}, **arguments), [2.0, 2.0, 2.0])


@pytest.mark.parametrize(
    ("result", "line"),
    [
        (lambda own: own, "found a result of type dict, expected the stage's result and `own`"),
        (
            lambda own: (jnp.zeros(3), {}),
            r"`own`: found a result of type dict without \['updates'\], expected one that has it",
        ),
        (lambda own: (jnp.zeros(3), {"updates": jnp.zeros(2)}), "found float64 of shape .2,. for the result"),
    ],
)
def test_a_memory_of_another_form_is_refused(result: Any, line: str) -> None:
    def law(deviation: Any, own: Any) -> Any:
        return result(own)

    arguments = {"gain": jnp.zeros((3, 6)), "deviation": jnp.ones(6), "estimate": None, "time": jnp.zeros(())}
    with pytest.raises(RpojaxError, match=line):
        Stages(formation_law=law).call_with_memory("formation_law", {"updates": jnp.zeros(())}, **arguments)


def test_own_is_no_argument_of_a_reference() -> None:
    with pytest.raises(RpojaxError, match="found the argument 'own'"):
        Stages(reference=lambda own, entry: entry)


def test_a_memory_of_texts_is_refused_in_one_line() -> None:
    stages = Stages(own_memory=lambda: {"name": "mine"})
    with pytest.raises(RpojaxError, match=r"^stages.own_memory: found a dict with others, expected numbers and arrays"):
        stages.initial_memory(params=None, estimate=None, attitude=None, camera=None)
