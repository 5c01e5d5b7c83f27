"""Playback of one run: what the page moves through its views and charts, as arrays over the stored ticks."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from rpojax.report import drawn_scenarios
from rpojax.report.campaign_results import CampaignResults, nominal_keep_out_radii
from rpojax.report.page import playback_geometry, run_series
from rpojax.report.page.packed_arrays import Packed, pack_bytes, pack_floats, pack_rounded
from rpojax.report.page.playback_geometry import Optics
from rpojax.report.page.run_series import History
from rpojax.report.page.run_timeline import MODE_WORDS
from rpojax.report.page.shown_mesh import shown_mesh

MAX_BYTES: Final = 2_000_000
"""Most bytes of the arrays in a page, which leaves as much for the rest of it."""
_SERVICER_BYTES: Final = 95
"""Bytes of an instant for each servicer, as base64; of each landmark below."""
_COMMON_BYTES: Final = 27
_LANDMARK_BYTES: Final = 6
_NO_LANDMARKS: Final = np.zeros((0, 0))
_SHOWN_FRAMES: Final = 2.0
"""Boxes farther away than so many widths of the frame are off the picture, and would coarsen the others."""
_LEAST_M_S: Final = 1e-7
"""Smaller changes of the velocity change are rounding of the channel."""
_READ_OUT: Final = ("formation_error_m", "nav_relative_error_m", "delta_v_m_s", "pointing_error_deg")
"""Series whose values the page shows as numbers; the range is the length of `rho_H`."""
FLAGS: Final = ("box_present", "box_accepted", "box_outlier", "nav_confident", "observable")
"""Bits of `flags`, the first the lowest; one more above them is set while the thruster burns."""


def playback(campaign: CampaignResults, run_id: int | None) -> dict[str, Any] | None:
    """Content of the playback of a run; None if its history has no positions, or not two of them."""
    if run_id is None:
        return None
    names = list(campaign.servicer_names) or [""]
    histories = [campaign.history(run_id, number) for number in range(len(names))]
    if any("rho_H" not in history for history in histories):
        return None
    ticks = shown_ticks(histories)
    if len(ticks) < 2:
        return None
    tables = drawn_scenarios.drawn_tables(campaign, run_id)
    first = {} if tables[0] is None else tables[0]
    R_HN = _hill_axes(histories[0], ticks)
    scenario = campaign.info.get("scenario", {})
    return {
        "time_s": pack_floats(histories[0]["time_s"][ticks]),
        "tick_s": float(np.median(np.diff(histories[0]["time_s"][ticks]))),
        "end_s": float(histories[0]["time_s"][ticks[-1]]),
        "duration_s": float(scenario.get("duration_s", histories[0]["time_s"][-1])),
        "phases": list(campaign.phase_names),
        "modes": [MODE_WORDS[mode] for mode in sorted(MODE_WORDS)],
        "flags": [*FLAGS, "burning"],
        "target": shown_mesh(scenario, float(first.get("target", {}).get("scale", 1.0))),
        "keep_out": max(nominal_keep_out_radii(campaign), default=None),
        "scene": _scene(histories[0], ticks, R_HN, first.get("epoch_utc")),
        "servicers": [
            _servicer(name, history, ticks, R_HN, own)
            for name, history, own in zip(names, histories, tables, strict=True)
        ],
    }


def shown_ticks(histories: Sequence[History]) -> np.ndarray:
    """Stored ticks that are shown: every n-th up to the end or the failure, which is among them, within `MAX_BYTES`."""
    finite = np.all([np.isfinite(history["rho_H"]).all(axis=1) for history in histories], axis=0)
    alive = np.flatnonzero(finite)
    if not len(alive):
        return alive
    landmarks = sum(history.get("landmarks_right_tangent", _NO_LANDMARKS).shape[1] for history in histories)
    most = MAX_BYTES // (_SERVICER_BYTES * len(histories) + _LANDMARK_BYTES * landmarks + _COMMON_BYTES)
    stride = -(-len(alive) // most)
    return alive[(len(alive) - 1) % stride :: stride]


def _hill_axes(history: History, ticks: np.ndarray) -> np.ndarray | None:
    """`R_HN` at the shown ticks, None if the positions of the target were not kept."""
    if "r_TN_N" not in history:
        return None
    alive = slice(0, int(ticks[-1]) + 1)
    return playback_geometry.hill_axes(history["time_s"][alive], history["r_TN_N"][alive])[ticks]


def _scene(history: History, ticks: np.ndarray, R_HN: np.ndarray | None, epoch: str | None) -> dict[str, Packed]:
    """Attitude of the target, direction to the Sun and its visible share, in Hill axes."""
    found: dict[str, Packed] = {}
    if R_HN is None:
        return found
    if "q_TN" in history:
        found["q_HT"] = pack_rounded(attitudes_in_hill(R_HN, history["q_TN"][ticks]))
    if epoch is not None:
        sun_N, visible = playback_geometry.sunlight(epoch, history["time_s"][ticks], history["r_TN_N"][ticks])
        found["sun_H"] = pack_rounded(np.einsum("nij,nj->ni", R_HN, sun_N))
        found["light"] = pack_bytes(np.round(255.0 * np.clip(visible, 0.0, 1.0)))
    return found


def attitudes_in_hill(R_HN: np.ndarray, q_BN: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4), scalar last, that turn body components into those of H; signs without jumps."""
    turns = R_HN @ drawn_scenarios.attitude_matrices(q_BN).transpose(0, 2, 1)
    q = Rotation.from_matrix(turns).as_quat()
    flips = np.sum(q[1:] * q[:-1], axis=1) < 0.0
    return q * np.where(np.concatenate([[0], np.cumsum(flips)]) % 2, -1.0, 1.0)[:, None]


def _known_attitudes_in_hill(R_HN: np.ndarray, q_TN: np.ndarray) -> np.ndarray:
    """Those of an estimate (n, 4), undefined before it was found."""
    known = np.isfinite(q_TN).all(axis=1)
    found = np.full(q_TN.shape, np.nan)
    if known.any():
        found[known] = attitudes_in_hill(R_HN[known], q_TN[known])
    return found


def _servicer(
    name: str, history: History, ticks: np.ndarray, R_HN: np.ndarray | None, tables: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Arrays and constants of one servicer."""
    at = {key: values[ticks] for key, values in history.items() if len(values) == len(history["time_s"])}
    arrays: dict[str, Packed] = {"rho_H": pack_floats(at["rho_H"]), "flags": pack_bytes(_flags(history, ticks))}
    for label, needed, values in run_series.SERIES:
        if label.name in _READ_OUT and set(needed) <= history.keys():
            arrays[label.name] = pack_floats(values(history)[ticks])
    if R_HN is not None and "q_BN" in at:
        arrays["q_HB"] = pack_rounded(attitudes_in_hill(R_HN, at["q_BN"]))
    if R_HN is not None and "q_TN_estimate" in at:
        arrays["q_HT_estimate"] = pack_rounded(_known_attitudes_in_hill(R_HN, at["q_TN_estimate"]))
        arrays |= {"landmarks": pack_bytes(at["landmarks_found"])} if "landmarks_found" in at else {}
    arrays |= {code: pack_bytes(at[code]) for code in ("mode", "phase") if code in at}
    if "rho_estimate_H" in at:
        arrays["estimate_offset_H"] = pack_rounded(at["rho_estimate_H"] - at["rho_H"])
    desired = np.asarray(history.get("rho_desired_H", np.zeros(0)), dtype=np.float64)
    if "rho_desired_H" in at:
        arrays["rho_desired_H"] = pack_rounded(at["rho_desired_H"])
    found: dict[str, Any] = {"name": name, "desired": desired.tolist() if desired.shape == (3,) else None}
    if tables is None:
        return {**found, "arrays": arrays, "zones": None, "camera": None}
    lens = playback_geometry.optics(tables)
    arrays |= _boxes(at, lens.width_px)
    focal_px = np.full(len(ticks), lens.focal_px)
    if "wide_lens" in at:
        focal_px = playback_geometry.focal_lengths(tables, at["wide_lens"])
        arrays["focal_px"] = pack_floats(focal_px)
    arrays |= _landmarks(at, lens, focal_px)
    return {
        **found,
        "arrays": arrays,
        "zones": playback_geometry.zones(tables),
        "side_m": playback_geometry.body_side(tables),
        "thrust_B": playback_geometry.thrust_direction(tables).tolist(),
        "camera": {
            "width": lens.width_px,
            "height": lens.height_px,
            "focal": lens.focal_px,
            "R_KB": lens.R_KB.ravel().tolist(),
        },
    }


def _landmarks(at: Mapping[str, np.ndarray], lens: Optics, focal_px: np.ndarray) -> dict[str, Packed]:
    """Places of the landmarks that were found [px], right and down in pairs, undefined for the others."""
    names = ("landmarks_right_tangent", "landmarks_down_tangent")
    if not set(names) <= at.keys():
        return {}
    tangents = np.stack([np.asarray(at[name], dtype=np.float64) for name in names], axis=-1)
    places = focal_px[:, None, None] * tangents + 0.5 * np.array([lens.width_px, lens.height_px])
    return {"landmarks_px": pack_rounded(places.reshape(len(focal_px), -1))}


def _flags(history: History, ticks: np.ndarray) -> np.ndarray:
    """Bits (n,) of `FLAGS` at the ticks, and whether the velocity change grew since the tick shown before."""
    bits = np.zeros(len(ticks), dtype=int)
    for place, name in enumerate(FLAGS):
        if name in history:
            bits |= np.asarray(history[name][ticks], dtype=bool).astype(int) << place
    if "delta_v_m_s" in history:
        spent = np.nan_to_num(np.asarray(history["delta_v_m_s"], dtype=np.float64))[ticks]
        bits |= (np.diff(spent, prepend=spent[0]) > _LEAST_M_S).astype(int) << len(FLAGS)
    return bits


def _boxes(at: Mapping[str, np.ndarray], width_px: int) -> dict[str, Packed]:
    """Boxes, true outlines, expected boxes and gates [px], undefined where there are none or far off the frame."""
    found: dict[str, Packed] = {}
    reach = _SHOWN_FRAMES * width_px
    for name in ("box_px", "outline_px", "expected_px"):
        if name not in at:
            continue
        rows = np.asarray(at[name], dtype=np.float64)
        shown = np.all(np.abs(rows) <= reach, axis=1) & np.all(rows[:, 2:] > 0.0, axis=1)
        if name == "box_px" and "box_present" in at:
            shown &= np.asarray(at["box_present"], dtype=bool)
        found[name] = pack_rounded(np.where(shown[:, None], rows, np.nan))
    if "gate_px" in at:
        found["gate_px"] = pack_rounded(np.minimum(np.asarray(at["gate_px"], dtype=np.float64), reach))
    return found
