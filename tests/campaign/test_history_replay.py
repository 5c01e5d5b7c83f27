"""Replay of a run for its full history."""

from dataclasses import replace

import numpy as np
import pytest
from rendered_run import RUN, RenderedRun

from rpojax.campaign.rerun import replay_history
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError


def test_run_with_replaced_stages_is_not_replayed(rendered_campaign: Campaign, rendered_run: RenderedRun) -> None:
    stages = {"update_orbit": {"function": "mine", "source_sha256": None}}
    with pytest.raises(RpojaxError, match=r"run 1: found replaced stages \['update_orbit'\]"):
        replay_history(rendered_run.file, replace(rendered_campaign.configuration, stages=stages), 1)


@pytest.mark.slow
def test_replayed_run_agrees_with_the_recorded_one(rendered_campaign: Campaign, rendered_run: RenderedRun) -> None:
    replayed = replay_history(rendered_run.file, rendered_campaign.configuration, RUN)
    # The first position is on an axis, its other components are zero but for rounding.
    np.testing.assert_allclose(replayed["rho_H"], rendered_run.history["rho_H"], rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(replayed["box_score"], rendered_run.history["box_score"], atol=0.01)
