"""A target that looks the same after a turn, and a scenario of it.

    python -m experiments.pose.symmetric_target --out DIR [--folds 2]

Writes `target.obj` and `pose_symmetric.toml`: a bus with a box on its top and as many panels around it as the symmetry
about z has attitudes, each beside its radius and turned about it, so that no other turn maps the body onto itself. Its
moments of inertia have the symmetry, too. Landmarks are found by

    rpojax landmarks DIR/target.obj --out DIR/target.landmarks.safetensors --count 20

and the scenario is `pose_inspection` with this target.
"""

import argparse
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from rpojax.training.synthetic_data.meshes import mesh_files, target_mesh

SIDES: Final = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
FACES: Final = ((3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
"""Corners of the sides of a box, counter-clockwise from outside."""
INERTIA: Final = {
    2: [[4.0, 0.2, 0.0], [0.2, 2.4, 0.0], [0.0, 0.0, 4.4]],
    4: [[3.2, 0.0, 0.0], [0.0, 3.2, 0.0], [0.0, 0.0, 4.4]],
}
"""By the number of attitudes that look alike [kg m^2]."""
DIRECTIONS: Final = {2: 64, 4: 256}
"""In which the corners that are farthest out make the hull: of the corners of four panels 64 miss one."""


def box(middle: tuple[float, float, float], half: tuple[float, float, float]) -> np.ndarray:
    """Corners (8, 3) of a box with its middle and half sides [m]."""
    corners = [[*side, z] for z in (-1.0, 1.0) for side in SIDES]
    return np.array(middle) + np.array(half) * np.array(corners)


def boxes(folds: int) -> list[np.ndarray]:
    """Corners of the boxes of the body."""
    bus = box((0.0, 0.0, 0.0), (0.25, 0.25, 0.3))
    top = box((0.0, 0.0, 0.38), (0.12, 0.12, 0.08))
    if folds == 2:
        bus, top = bus * [0.8, 1.0, 1.0], top * [1.3, 0.7, 1.0]
    tilt = Rotation.from_euler("y", 20.0, degrees=True)
    panel = np.array([0.06, 0.0, 0.05]) + tilt.apply(box((0.0, 0.53, 0.0), (0.2, 0.25, 0.015)))
    turns = [Rotation.from_euler("z", 360.0 * number / folds, degrees=True) for number in range(folds)]
    return [bus, top, *(turn.apply(panel) for turn in turns)]


def write_mesh(path: Path, folds: int) -> None:
    """Writes the body as OBJ."""
    lines, first = [], 1
    for corners in boxes(folds):
        lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners]
        lines += ["f " + " ".join(str(first + number) for number in face) for face in FACES]
        first += len(corners)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def scenario(mesh: Path, landmarks: Path, folds: int) -> str:
    """`pose_inspection` with this target, as TOML."""
    target = mesh_files.load_mesh(mesh)
    hull = target_mesh.outline_vertices(target, DIRECTIONS[folds])
    return f"""extends = "pose_inspection"
name = "pose_symmetric"
description = "Attitude of a target that looks the same in {folds} attitudes, from 15 m"

[target]
inertia_kg_m2 = {INERTIA[folds]}
hull_m = {hull.tolist()}

[navigation]
target_size_m = {target_mesh.apparent_size(hull):.3f}

[camera]
landmarks = "{landmarks.resolve()}"
"""


def main() -> int:
    """Writes both files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--folds", type=int, choices=sorted(INERTIA), default=2)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    mesh = asked.out / "target.obj"
    write_mesh(mesh, asked.folds)
    landmarks = asked.out / "target.landmarks.safetensors"
    (asked.out / "pose_symmetric.toml").write_text(scenario(mesh, landmarks, asked.folds), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
