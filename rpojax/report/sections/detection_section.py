"""Detector performance: boxes by range from the stored histories of a campaign."""

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from rpojax.core.pytree import concatenate
from rpojax.report.labels import LOOK_AWAY_MODES, format_number
from rpojax.vision.intersection_over_union import intersection_over_union

History = Mapping[str, np.ndarray]
Frames = dict[str, np.ndarray]
_CHANNELS = (
    *("range_m", "mode", "observable", "box_present", "box_accepted", "box_outlier", "box_truncated"),
    *("box_px", "box_score", "outline_px"),
)
_RANGE_EDGES_M = (
    *(0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0),
    *(40.0, 50.0, 70.0, 100.0, 150.0, 200.0, 300.0, 500.0, 1000.0),
)
_MIN_FRAMES = 20
"""Fewest frames of a range interval, and fewest boxes for edge statistics."""
_EDGES = ("left", "top", "right", "bottom")
_SCORE_PERCENTILES = (5.0, 50.0, 95.0)


def detections_by_range(histories: Iterable[History]) -> list[dict[str, Any]]:
    """Part of report.json: statistics of the boxes over all frames and by range; empty without histories.

    Histories without scores and true outlines are left out.
    """
    frames = _concatenated_frames([history for history in histories if all(name in history for name in _CHANNELS)])
    if not frames:
        return []
    lines = [{"range_m": None, **_range_entry(frames)}]
    bounds = (*_RANGE_EDGES_M, np.inf)
    for low, high in pairwise(bounds):
        inside = (frames["range_m"] >= low) & (frames["range_m"] < high)
        if inside.sum() >= _MIN_FRAMES:
            part = {name: values[inside] for name, values in frames.items()}
            lines.append({"range_m": [low, high if np.isfinite(high) else None], **_range_entry(part)})
    # A single range interval equals the line for all frames.
    return lines if len(lines) > 2 else lines[:1]


def table_cells(lines: list[dict[str, Any]]) -> dict[str, list[list[str]]]:
    """Cells of two tables of the page: `boxes`, and `edges` for ranges with enough whole true boxes."""
    fractions = ("boxes_per_frame", "accepted", "false_per_frame", "false_per_away_frame", "cut")
    boxes = [
        [_range_text(line), str(line["frames"]), str(line["away_frames"]), str(line["boxes"])]
        + [_percent(line[name]) for name in fractions]
        + [
            format_number(line["score"][key], 3) if line["score"] else format_number(None)
            for key in ("p5", "p50", "p95")
        ]
        for line in lines
    ]
    edges = [
        [_range_text(line), str(line["edges"]["boxes"]), format_number(line["edges"]["side_px"], 3)]
        + [f"{line['edges'][edge]['bias_px']:+z.2f} ± {line['edges'][edge]['sigma_px']:.2f}" for edge in _EDGES]
        + [_percent(line["edges"]["overlap"])]
        for line in lines
        if line["edges"]
    ]
    return {"boxes": boxes, "edges": edges}


def _concatenated_frames(histories: list[History]) -> Frames:
    """Channels of all frames up to the end or failure of each run, concatenated."""
    if not histories:
        return {}
    frames = concatenate([{name: history[name] for name in _CHANNELS} for history in histories])
    alive = np.isfinite(frames["range_m"])
    return {name: values[alive] for name, values in frames.items()}


def _range_entry(frames: Frames) -> dict[str, Any]:
    present, outlier, light = frames["box_present"], frames["box_outlier"], frames["observable"]
    away = np.isin(frames["mode"], LOOK_AWAY_MODES)
    on_target = light & ~away
    scores = frames["box_score"][present]
    return {
        "frames": int(on_target.sum()),
        "away_frames": int((light & away).sum()),
        "boxes": int(present.sum()),
        "boxes_per_frame": _fraction(present, on_target),
        "accepted": _fraction(frames["box_accepted"], present),
        "false_per_frame": _fraction(outlier, on_target),
        "false_per_away_frame": _fraction(outlier, light & away),
        "cut": _fraction(frames["box_truncated"], present),
        "score": {f"p{q:.0f}": float(np.percentile(scores, q)) for q in _SCORE_PERCENTILES} if len(scores) else None,
        "edges": _edge_errors(frames, present & ~outlier & ~frames["box_truncated"]),
    }


def _edge_errors(frames: Frames, chosen: np.ndarray) -> dict[str, Any] | None:
    """Edge errors [px] of the chosen boxes, positive to the right and down, and mean overlap with the truth."""
    box, true = (_corners(frames[name][chosen].astype(float)) for name in ("box_px", "outline_px"))
    if len(box) < _MIN_FRAMES:
        return None
    error = box - true
    sides = true[:, 2:] - true[:, :2]
    return {
        "boxes": len(box),
        "side_px": float(np.median(np.sqrt(sides.prod(axis=1)))),
        "overlap": float(intersection_over_union(box, true).mean()),
        **{
            edge: {"bias_px": float(error[:, column].mean()), "sigma_px": float(error[:, column].std())}
            for column, edge in enumerate(_EDGES)
        },
    }


def _corners(boxes: np.ndarray) -> np.ndarray:
    return np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1)


def _fraction(part: np.ndarray, whole: np.ndarray) -> float | None:
    return float((part & whole).sum() / whole.sum()) if whole.any() else None


def _range_text(line: Mapping[str, Any]) -> str:
    if line["range_m"] is None:
        return "all"
    low, high = line["range_m"]
    return f"{low:.0f}\N{EN DASH}{high:.0f} m" if high is not None else f"beyond {low:.0f} m"


def _percent(fraction: float | None) -> str:
    return format_number(None) if fraction is None else f"{100.0 * fraction:.3g} %"
