"""Landmarks of the packaged target: how many are seen, the faces on which a port may be, and the table against rays."""

import argparse
import math

import jax
import numpy as np

from rpojax.core.numerics.fibonacci_sphere import fibonacci_sphere
from rpojax.training.synthetic_data.meshes.packaged_target import packaged_target
from rpojax.vision.surface.landmark_file import load_landmarks
from rpojax.vision.surface.landmark_selection import select_landmarks
from rpojax.vision.surface.landmarks import LandmarkError, Landmarks, are_free, free_rays
from rpojax.vision.surface.port_view import PortView

PIXEL = math.tan(math.radians(22.5)) / 384.0
"""Angle of a pixel in the middle of the wide lens [rad]."""
PORTS = {
    "+z, between the panels, on the side of the cells": ((0.0, 0.0, 0.303), (0.0, 0.0, 1.0)),
    "-x, within the launch adapter ring": ((-0.247, 0.0, 0.06), (-1.0, 0.0, 0.0)),
    "+x": ((0.247, 0.0, 0.0), (1.0, 0.0, 0.0)),
    "-z": ((0.0, 0.0, -0.303), (0.0, 0.0, -1.0)),
}


def pose_scatter(landmarks: Landmarks, view: PortView) -> tuple[int, float, float]:
    """Landmarks on a port's face, and the largest standard deviations of attitude [deg] and place [mm] at 1 px."""
    arrays = (np.asarray(each) for each in (landmarks.positions, landmarks.normals, landmarks.visible))
    places = np.asarray(landmarks.positions)[view.on_face(*arrays)]
    lines = view.camera() - places
    distances = np.linalg.norm(lines, axis=1)[:, None, None]
    along = lines[:, :, None] / distances
    across = (np.eye(3) - along * along.transpose(0, 2, 1)) / distances / PIXEL
    turns = np.cross(np.eye(3)[None], places[:, None]).transpose(0, 2, 1)
    rows = np.concatenate([across @ turns, across], axis=2).reshape(-1, 6)
    sigma = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    return len(places), math.degrees(sigma[:3].max()), 1e3 * sigma[3:].max()


def main() -> int:
    """Prints the figures; the exit status is 1 where fewer than 8 landmarks are seen from a direction."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--directions", type=int, default=2000)
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    triangles = np.concatenate([part.vertices[part.faces] for part in packaged_target().parts])
    landmarks = load_landmarks()[0]
    rays = fibonacci_sphere(asked.directions).T
    shape = landmarks.positions.shape
    called = np.array([are_free(landmarks.visible, np.broadcast_to(ray, shape)) for ray in rays])
    counts = called.sum(axis=1)
    shares = ", ".join(f"{each:.0f}" for each in np.percentile(counts, [0.0, 5.0, 50.0, 100.0]))
    print(f"{len(counts)} directions: least, 5 %, median and most landmarks seen {shares}")
    free = free_rays(np.asarray(landmarks.positions), np.asarray(landmarks.normals), triangles, rays).T
    print(
        f"called visible and hidden {np.mean(called & ~free):.2%}, free and not called so {np.mean(free & ~called):.2%}"
    )
    for name, (position, axis) in PORTS.items():
        view = PortView(np.array(position), np.array(axis))
        try:
            count, attitude, place = pose_scatter(select_landmarks(triangles, 20, view), view)
        except LandmarkError as error:
            print(f"port {name}: {error}")
            continue
        print(f"port {name}: {count} on its face, {attitude:.2f} deg, {place:.1f} mm")
    return int(counts.min() < 8)


if __name__ == "__main__":
    raise SystemExit(main())
