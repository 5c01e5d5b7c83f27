"""Picture of a target's mesh with its numbered landmarks, from three directions."""

import io

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from rpojax.core import frames
from rpojax.vision.surface.landmarks import Landmarks, are_free
from rpojax.vision.surface.surface_corners import body_size

_DIRECTIONS = {
    "from +x +y +z": (1.0, 0.7, 0.6),
    "from -x -y +z": (-1.0, -0.6, 0.5),
    "from +x -y -z": (0.7, -1.0, -0.7),
}
"""From the middle of the target to the eye; the first one is along the port's axis if there is a port."""
_SEEN, _HIDDEN, _PORT = "#c02020", "#8090a0", "#1060c0"


def landmark_picture(triangles: np.ndarray, landmarks: Landmarks) -> bytes:
    """PNG of triangles (t, 3, 3) in T [m] with their landmarks: filled where they can be seen, hollow where not."""
    figure = Figure(figsize=(18.0, 6.6), dpi=90, layout="constrained")
    directions = {title: np.array(each) for title, each in _DIRECTIONS.items()}
    if landmarks.port_axis is not None:
        directions = {"along the port's axis": np.asarray(landmarks.port_axis), **directions}
    for place, (title, away) in enumerate(list(directions.items())[:3], start=1):
        axes = figure.add_subplot(1, 3, place)
        axes.set_title(title)
        _draw(axes, triangles, landmarks, away / np.linalg.norm(away))
    content = io.BytesIO()
    figure.savefig(content, format="png")
    return content.getvalue()


def _draw(axes: Axes, triangles: np.ndarray, landmarks: Landmarks, away: np.ndarray) -> None:
    """Draws a parallel projection, the farthest triangles first."""
    right = np.array([1.0, 0.0, 0.0]) if abs(away[2]) > 0.9 else np.cross([0.0, 0.0, 1.0], away)
    R_KT = np.asarray(frames.look_at(jnp.asarray(-away), jnp.asarray(right)))
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    facing = normals @ away / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    order = np.argsort((triangles @ away).mean(axis=1))
    order = order[facing[order] > 0.0]
    shades = np.repeat((0.55 + 0.4 * facing[order])[:, None], 3, axis=1)
    outlines = (triangles[order] @ R_KT[:2].T) * [1.0, -1.0]
    axes.add_collection(
        PolyCollection(list(outlines), facecolors=shades.tolist(), edgecolors="#00000030", linewidths=0.3)
    )
    positions = np.asarray(landmarks.positions)
    places = (positions @ R_KT[:2].T) * [1.0, -1.0]
    seen = np.asarray(are_free(landmarks.visible, jnp.broadcast_to(jnp.asarray(away), positions.shape)))
    for number, (place, is_seen) in enumerate(zip(places, seen, strict=True)):
        color = _SEEN if is_seen else _HIDDEN
        axes.plot(*place, "o", markersize=6, color=color, markerfacecolor=color if is_seen else "none")
        axes.annotate(str(number), place, xytext=(5, 5), textcoords="offset points", color=color, fontsize=11)
    if landmarks.port_position is not None and landmarks.port_axis is not None:
        ends = np.stack(
            [landmarks.port_position, landmarks.port_position + 0.2 * body_size(triangles) * landmarks.port_axis]
        )
        axes.plot(*((ends @ R_KT[:2].T) * [1.0, -1.0]).T, "-", color=_PORT, linewidth=2)
        axes.plot(*((ends[:1] @ R_KT[:2].T) * [1.0, -1.0]).T, "s", color=_PORT, markersize=7)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()
