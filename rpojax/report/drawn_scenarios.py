"""Scenarios of single runs: the recorded one with the values drawn for a run, and the camera's axes in it."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from rpojax.errors import RpojaxError
from rpojax.report.campaign_results import CampaignResults
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.numbers.section_records import record_of
from rpojax.scenario.team.members import member_files
from rpojax.sensors import camera_pose
from rpojax.sensors.camera import Camera, WideLens, through_wide


def drawn_tables(campaign: CampaignResults, run_id: int) -> Sequence[dict[str, Any] | None]:
    """Scenario of each servicer with the values drawn for a run; None if the recorded one cannot be read."""
    names = list(campaign.servicer_names) or [""]
    try:
        members = member_files(scenario_loader.validate_recorded(campaign.info.get("scenario", {})))
    except (RpojaxError, KeyError, TypeError):
        return [None] * len(names)
    row = int(np.flatnonzero(campaign.run_ids == run_id)[0])
    return [_with_drawn(each.model_dump(), campaign, row, name) for each, name in zip(members, names, strict=True)]


def _with_drawn(tables: dict[str, Any], campaign: CampaignResults, row: int, name: str) -> dict[str, Any]:
    """Tables of a servicer with the values drawn in a row of the campaign."""
    for key, values in campaign.drawn.items():
        path, _, servicer = key.partition("/")
        section, _, leaf = path.partition(".")
        if servicer in ("", name) and leaf in tables.get(section, {}):
            tables[section][leaf] = np.asarray(values[row]).tolist()
    return tables


def camera_axes(tables: Mapping[str, Any], through_wide_lens: bool = False) -> np.ndarray:
    """`R_KB` (3, 3) of the true camera of a servicer's scenario, through its own lens or the wide one."""
    camera = record_of(Camera, tables, "camera")
    if through_wide_lens:
        camera = through_wide(camera, record_of(WideLens, tables, "wide_lens"), jnp.array(True))
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], dtype=jnp.float64)
    return attitude_matrices(np.asarray(camera_pose.camera_attitude(camera, identity))[None])[0]


def attitude_matrices(q: np.ndarray) -> np.ndarray:
    """Direction cosine matrices (n, 3, 3) of scalar-first quaternions (n, 4)."""
    return Rotation.from_quat(np.roll(np.asarray(q, dtype=np.float64), -1, axis=-1)).as_matrix()
