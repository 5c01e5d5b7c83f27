"""Relative paths of runs for the page's 3-D view: target mesh, keep-out sphere, desired positions, paths."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.dispersed_inputs import nominal_keep_out_radii

_MAX_POINTS: Final = 240
"""Most points of a path."""
_MAX_RUNS: Final = 24
_ANY_FACET_SIZE_M: Final = 1e3


HistoryReader = Callable[[int], Mapping[str, np.ndarray]]
"""Reads the history of a run."""


def path_scene(
    campaign: CampaignResults, median_run: int | None, worst: Sequence[int], read: HistoryReader | None = None
) -> dict[str, Any] | None:
    """Content of the 3-D view in Hill axes [m]; None if no history holds relative positions.

    Paths are those of the runs with a history, the median one and the `worst` ones named, the others as context.
    Histories come from `read`, by default from the campaign.
    """
    history_of = read or campaign.history
    kept = sorted(campaign.history_ids)
    chosen = [run for run in dict.fromkeys([*([] if median_run is None else [median_run]), *worst]) if run in kept]
    shown = [*chosen, *(run for run in kept if run not in chosen)][:_MAX_RUNS]
    paths = [path for run in shown for path in _paths(campaign, history_of(run), run, _kind(run, median_run, worst))]
    if not paths:
        return None
    scenario = campaign.info.get("scenario", {})
    return {
        "paths": paths,
        "target": _mesh(scenario),
        "keep_out_m": max(radii := nominal_keep_out_radii(campaign), default=None),
        "spheres_m": radii,
        "desired": _desired(campaign, history_of(shown[0])),
    }


def _kind(run: int, median_run: int | None, worst: Sequence[int]) -> str:
    if run in worst and run != median_run:
        return "worst"
    return "median" if run == median_run else "other"


def _paths(campaign: CampaignResults, history: Mapping[str, np.ndarray], run: int, kind: str) -> list[dict[str, Any]]:
    """Paths of one run, one for each servicer."""
    if "rho_H" not in history:
        return []
    rho = np.asarray(history["rho_H"], dtype=np.float64)
    names = list(campaign.servicer_names) or [""]
    columns = [rho[:, number] for number in range(len(names))] if campaign.servicer_names else [rho]
    return [
        {"run": run, "kind": kind, "servicer": name, "points": _thinned(column)}
        for name, column in zip(names, columns, strict=True)
    ]


def _thinned(points: np.ndarray) -> list[float]:
    """Coordinates of at most `_MAX_POINTS` finite points, the last one included, in a row."""
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return []
    rows = np.unique(np.linspace(0, len(finite) - 1, min(len(finite), _MAX_POINTS)).astype(int))
    return [float(f"{value:.4g}") for value in finite[rows].ravel()]


def _desired(campaign: CampaignResults, history: Mapping[str, np.ndarray]) -> list[list[float]]:
    """Desired positions [m]: one for each servicer; none where it moves."""
    desired = np.asarray(history.get("rho_desired_H", np.zeros(0)), dtype=np.float64)
    if campaign.servicer_names and desired.shape == (len(campaign.servicer_names), 3):
        return desired.round(3).tolist()
    return [desired.round(3).tolist()] if desired.shape == (3,) else []


def _mesh(scenario: Mapping[str, Any]) -> dict[str, Any] | None:
    """Corners and triangles of the target in its body axes [m]; its hull if there is no mesh, None without either."""
    # Imported here because meshes need packages that other pages do without.
    from rpojax.scenario.trained.coverage_surface import HULL, surface_triangles

    # The size of facets matters to coverage alone; a large one is never refused.
    coverage = {"surface": HULL, **scenario.get("coverage", {}), "facet_size_m": _ANY_FACET_SIZE_M}
    for surface in dict.fromkeys((coverage["surface"], HULL)):
        tables = {**scenario, "coverage": {**coverage, "surface": surface}}
        try:
            triangles = surface_triangles(tables)
        except (RpojaxError, KeyError):
            continue
        corners, numbers = np.unique(triangles.reshape(-1, 3).round(3), axis=0, return_inverse=True)
        return {"corners": corners.ravel().tolist(), "triangles": np.asarray(numbers).ravel().tolist()}
    return None
