"""Poses from landmarks against OpenCV: the same optimum, how often each finds the best one, and time in a batch."""

import argparse
import itertools
import math
import time
from dataclasses import dataclass

import cv2
import jax
import jax.numpy as jnp
import numpy as np

from rpojax.batching.vmap_last_axis import vmap
from rpojax.core import quaternion
from rpojax.flight.navigation.perspective_n_point import PoseHypotheses, solve_pose
from rpojax.runtime.compiler_options import LOOP_OPTIONS
from rpojax.vision.surface.landmark_file import load_landmarks
from rpojax.vision.surface.landmarks import are_free

TOLERANCE = 1e-6
"""Difference of attitudes [rad] and relative difference of positions of one optimum."""
SAME_COST = 1e-6
"""Relative difference of costs, beyond which one optimum is better than another."""
FEWEST = 6
RANGES_M = (1.2, 30.0)
NOISE_PX = (0.5, 2.0)
LENSES = ((12.0, 0.5 * 768 / math.tan(math.radians(22.5))), (math.inf, 0.5 * 768 / math.tan(math.radians(10.0))))
"""Range up to which a lens is used [m], and its focal length [px]: those of `final_approach`."""
BANDS_M = (1.2, 3.0, 12.0, 30.0)
HALF_FRAME_PX = 384.0
METHODS = {"SQPnP": cv2.SOLVEPNP_SQPNP, "iterative": cv2.SOLVEPNP_ITERATIVE}
_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-15)


@dataclass(frozen=True)
class Cases:
    """Random views of landmarks (n, 3) [m].

    Attributes:
        landmarks: (n, 3) [m]
        image: (c, n, 2) coordinates x / z, y / z with noise
        weights: (c, n) one over the variance of a coordinate, 0 where a landmark is not seen
        rotations: (c, 3, 3) true `R_KT`
        positions: (c, 3) true `r_TK_K` [m]
        ranges: (c,) [m]
    """

    landmarks: np.ndarray
    image: np.ndarray
    weights: np.ndarray
    rotations: np.ndarray
    positions: np.ndarray
    ranges: np.ndarray


def random_cases(count: int, seed: int) -> Cases:
    """Views of the packaged target's landmarks: any attitude, anywhere in the frame, six landmarks seen at least."""
    landmarks = load_landmarks()[0]
    rng = np.random.default_rng(seed)
    drawn = 2 * count + 50
    quaternions = rng.normal(size=(drawn, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    rotations = np.array(jax.vmap(quaternion.to_matrix)(jnp.asarray(quaternions)))
    ranges = np.exp(rng.uniform(*np.log(RANGES_M), size=drawn))
    focal = np.where(ranges <= LENSES[0][0], LENSES[0][1], LENSES[1][1])
    place = rng.uniform(-0.6, 0.6, size=(drawn, 2)) * (HALF_FRAME_PX / focal)[:, None]
    lines = np.concatenate([place, np.ones((drawn, 1))], axis=1)
    positions = ranges[:, None] * lines / np.linalg.norm(lines, axis=1, keepdims=True)
    points = np.array(landmarks.positions)
    seen_at = np.einsum("cij,nj->cni", rotations, points) + positions[:, None]
    image = seen_at[..., :2] / np.maximum(seen_at[..., 2:], 1e-3)
    cameras = -np.einsum("cji,cj->ci", rotations, positions)
    free = jax.jit(jax.vmap(lambda camera: are_free(landmarks.visible, camera[None] - landmarks.positions)))
    in_frame = (np.abs(image) * focal[:, None, None] < HALF_FRAME_PX).all(axis=2) & (seen_at[..., 2] > 0.1)
    # Some landmarks that could be seen are not found; at times all are.
    found = rng.uniform(size=(drawn, len(points))) > rng.choice([0.0, 0.2, 0.4], size=(drawn, 1))
    visible = np.array(free(cameras)) & in_frame & found
    sigma = rng.uniform(*NOISE_PX, size=drawn) / focal
    image += sigma[:, None, None] * rng.normal(size=image.shape)
    kept = np.flatnonzero(visible.sum(axis=1) >= FEWEST)[:count]
    weights = visible / (sigma**2)[:, None]
    return Cases(points, *(each[kept] for each in (image, weights, rotations, positions, ranges)))


def solve(cases: Cases) -> PoseHypotheses:
    """Hypotheses of all cases."""
    return jax.jit(jax.vmap(solve_pose, in_axes=(None, 0, 0)))(cases.landmarks, cases.image, cases.weights)


def cost_of(cases: Cases, number: int, rotation: np.ndarray, position: np.ndarray) -> float:
    """Sum of the weighted squares of residuals of a pose; infinite behind the camera."""
    seen = cases.weights[number] > 0.0
    places = cases.landmarks[seen] @ rotation.T + position
    if places[:, 2].min() <= 0.0:
        return math.inf
    residuals = places[:, :2] / places[:, 2:] - cases.image[number, seen]
    return float(np.sum(cases.weights[number, seen, None] * residuals**2))


def refined_by_opencv(
    cases: Cases, number: int, turn: np.ndarray, position: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost, rotation and position after OpenCV's refinement of a pose, which is a rotation vector (3, 1) and (3, 1)."""
    seen = cases.weights[number] > 0.0
    points, pixels = cases.landmarks[seen], cases.image[number, seen]
    turn, position = cv2.solvePnPRefineLM(points, pixels, np.eye(3), None, turn.copy(), position.copy(), _CRITERIA)
    # The former stops at some 1e-4 rad where landmarks tell little; steps of Gauss and Newton go on.
    for _ in range(2):
        turn, position = cv2.solvePnPRefineVVS(points, pixels, np.eye(3), None, turn, position, _CRITERIA, 1.0)
    rotation = cv2.Rodrigues(turn)[0]
    return cost_of(cases, number, rotation, position[:, 0]), rotation, position[:, 0]


def by_opencv(cases: Cases, number: int, method: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost, rotation and position of the best solution of a method of OpenCV after its refinement."""
    seen = cases.weights[number] > 0.0
    points, pixels = cases.landmarks[seen], cases.image[number, seen]
    nothing = math.inf, np.eye(3), np.zeros(3)
    try:
        _, turns, positions, _ = cv2.solvePnPGeneric(points, pixels, np.eye(3), None, flags=method)
    except cv2.error:
        return nothing
    found = [refined_by_opencv(cases, number, *pose) for pose in zip(turns, positions, strict=True)]
    return min(found, key=lambda each: each[0], default=nothing)


def by_opencv_from_truth(cases: Cases, number: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost, rotation and position of OpenCV's refinement of the true pose."""
    turn = cv2.Rodrigues(cases.rotations[number])[0]
    return refined_by_opencv(cases, number, turn, cases.positions[number][:, None])


def angles_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles (n,) [rad] between rotation matrices (n, 3, 3)."""
    chord = np.linalg.norm(a - b, axis=(1, 2)) / math.sqrt(8.0)
    return 2.0 * np.arcsin(np.minimum(chord, 1.0))


def time_in_batch(cases: Cases, runs: int = 128) -> float:
    """Least time of one run in a batch on one core [s]."""
    image, weights = np.moveaxis(cases.image[:runs], 0, -1), np.moveaxis(cases.weights[:runs], 0, -1)
    lowered = jax.jit(vmap(solve_pose, (None, -1, -1), -1)).lower(cases.landmarks, image, weights)
    compiled = lowered.compile(compiler_options=dict(LOOP_OPTIONS))
    times = []
    for _ in range(30):
        start = time.perf_counter()
        jax.block_until_ready(compiled(cases.landmarks, image, weights))
        times.append(time.perf_counter() - start)
    return min(times) / image.shape[-1]


def compare(cases: Cases) -> dict[str, dict[str, np.ndarray]]:
    """Of each method: whether it has the better optimum, or this package has, and differences of the same one."""
    ours = solve(cases)
    cost = np.asarray(ours.cost[:, 0])
    rotations = np.asarray(jax.vmap(quaternion.to_matrix)(ours.q_KT[:, 0]))
    positions = np.asarray(ours.r_TK_K[:, 0])
    numbers = range(len(cost))
    tried = {name: [by_opencv(cases, number, method) for number in numbers] for name, method in METHODS.items()}
    tried["from the true pose"] = [by_opencv_from_truth(cases, number) for number in numbers]
    found = {}
    for name, results in tried.items():
        other_cost, other_rotations, other_positions = map(np.array, zip(*results, strict=True))
        same = np.abs(other_cost - cost) <= SAME_COST * cost
        angles = angles_between(rotations, other_rotations)
        shifts = np.linalg.norm(positions - other_positions, axis=1) / np.linalg.norm(positions, axis=1)
        found[name] = {
            "theirs": other_cost < cost * (1.0 - SAME_COST),
            "ours": cost < other_cost * (1.0 - SAME_COST),
            "angles": angles[same],
            "shifts": shifts[same],
        }
    return found


def print_errors(cases: Cases, found: PoseHypotheses) -> None:
    """Errors of the first hypothesis by range, and their squares over what its covariance says."""
    truth = jax.vmap(quaternion.from_matrix)(jnp.asarray(cases.rotations))
    turns = jax.vmap(lambda q, p: quaternion.log(quaternion.multiply(q, quaternion.conjugate(p))))(
        truth, found.q_KT[:, 0]
    )
    shifts = cases.positions - np.asarray(found.r_TK_K[:, 0])
    errors = np.concatenate([turns, shifts], axis=1)
    squares = np.einsum("ci,cij,cj->c", errors, np.asarray(found.information[:, 0]), errors)
    for near, far in itertools.pairwise(BANDS_M):
        rows = (cases.ranges >= near) & (cases.ranges < far)
        angles = np.degrees(np.linalg.norm(errors[rows, :3], axis=1))
        places = np.linalg.norm(shifts[rows], axis=1)
        print(
            f"{near:g} to {far:g} m: {rows.sum()} cases, 50 and 99 % {np.percentile(angles, 50.0):.2g} and "
            f"{np.percentile(angles, 99.0):.2g} deg, {np.percentile(places, 50.0):.2g} and "
            f"{np.percentile(places, 99.0):.2g} m, more than 10 deg {(angles > 10.0).sum()}, squares of errors over "
            f"covariance, median {np.median(squares[rows]):.2f} (5.35 expected)"
        )


def main() -> int:
    """Prints the figures; the exit status is 1 where OpenCV has a better optimum, or the same one elsewhere."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    cases = random_cases(asked.cases, asked.seed)
    seen = (cases.weights > 0.0).sum(axis=1)
    print(f"{len(seen)} cases, {seen.min()} to {seen.max()} landmarks seen, median {np.median(seen):.0f}")
    holds = True
    for name, found in compare(cases).items():
        counts = found["theirs"].sum(), found["ours"].sum(), len(found["angles"])
        print(f"{name}: better {counts[0]}, worse {counts[1]}, same optimum {counts[2]}")
        for what in ("angles", "shifts"):
            low, high = np.percentile(found[what], [50.0, 99.9])
            print(f"    {what}: 50 and 99.9 % {low:.2g} and {high:.2g}, most {found[what].max():.2g}")
            holds &= bool(found[what].max() <= TOLERANCE)
        holds &= not found["theirs"].any()
    ours = solve(cases)
    print_errors(cases, ours)
    print(f"hypotheses: {np.bincount(np.asarray(ours.exists).sum(axis=1), minlength=5)[1:].tolist()} cases with 1 to 4")
    print(f"time: {1e6 * time_in_batch(cases):.0f} us a run of a batch of 128")
    return int(not holds)


if __name__ == "__main__":
    raise SystemExit(main())
