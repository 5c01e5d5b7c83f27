"""Points of the AFRL inspection benchmark that the servicers of a campaign have inspected.

python experiments/several_observers/benchmark_points.py DIR [--orbits 1.0]

100 points lie evenly on a sphere of 10 m around the target, fixed in its Hill frame (`safe-autonomy-sims`). One is
inspected when a servicer that has an accepted box sees it above the sphere's horizon, and the Sun is above it too. Of
each run with a stored history; one line of JSON.
"""

import argparse
import json
from pathlib import Path

import numpy as np

import rpojax

rpojax.prepare_process()

import jax.numpy as jnp  # noqa: E402

from rpojax.campaign.storage.campaign_folder import Campaign  # noqa: E402
from rpojax.core.constants import MU_EARTH  # noqa: E402
from rpojax.core.orbits import sun_moon_ephemeris  # noqa: E402
from rpojax.flight.team_guidance.direction_map import DIRECTIONS  # noqa: E402
from rpojax.value_types import epoch_seconds  # noqa: E402

RADIUS_M = 10.0


def sun_directions_H(r_TN_N: np.ndarray, time_s: np.ndarray, epoch_s: float) -> np.ndarray:
    """Directions to the Sun (ticks, 3) in the Hill frame of positions (ticks, 3) [m] along an orbit."""
    radial = r_TN_N / np.linalg.norm(r_TN_N, axis=1, keepdims=True)
    normal = np.cross(radial, np.gradient(r_TN_N, time_s, axis=0))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    axes = np.stack([radial, np.cross(normal, radial), normal], axis=1)
    epoch = sun_moon_ephemeris.epoch_at(epoch_s)
    sun_N = np.asarray(sun_moon_ephemeris.sun_position(jnp.float64(time_s.mean()), epoch))
    return axes @ (sun_N / np.linalg.norm(sun_N))


def inspected(history: dict[str, np.ndarray], sun_H: np.ndarray) -> np.ndarray:
    """Points (ticks, 100) that one servicer inspects in each tick."""
    place = history["rho_H"].astype(float)
    # Above the horizon of the sphere: the line from the point to the servicer leaves the sphere.
    above = place @ DIRECTIONS > RADIUS_M
    return above & (sun_H @ DIRECTIONS > 0.0) & history["box_accepted"].astype(bool)[:, None]


def main() -> None:
    """Prints one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path)
    parser.add_argument("--orbits", type=float, default=1.0)
    arguments = parser.parse_args()
    campaign = Campaign(arguments.directory)
    shares: dict[str, list[float]] = {name: [] for name in (*campaign.servicer_names, "team", "ever lit")}
    period_s = 2.0 * np.pi * np.sqrt(campaign.file.orbit.semi_major_axis_m**3 / MU_EARTH)
    for run_id in campaign.history_ids:
        histories = [campaign.history(run_id, number) for number in range(len(campaign.servicer_names))]
        time_s = histories[0]["time_s"].astype(float)
        epoch_s = epoch_seconds(campaign.file.epoch_utc)
        sun_H = sun_directions_H(histories[0]["r_TN_N"].astype(float), time_s, epoch_s)
        within = time_s <= arguments.orbits * period_s
        each = [inspected(history, sun_H)[within].any(axis=0) for history in histories]
        for name, seen in zip(campaign.servicer_names, each, strict=True):
            shares[name].append(float(seen.mean()))
        shares["team"].append(float(np.any(each, axis=0).mean()))
        shares["ever lit"].append(float((sun_H[within] @ DIRECTIONS > 0.0).any(axis=0).mean()))
    print(
        json.dumps(
            {
                "runs": len(campaign.history_ids),
                "orbits": arguments.orbits,
                **{f"median share of the points, {name}": round(float(np.median(v)), 4) for name, v in shares.items()},
            }
        )
    )


if __name__ == "__main__":
    main()
