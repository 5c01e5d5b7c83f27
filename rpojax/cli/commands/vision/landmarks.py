"""The command `rpojax landmarks`: landmarks of a target for the estimate of its pose."""

import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.cli.console import show_lines
from rpojax.cli.options.vision import LandmarksCommand, PortOptions
from rpojax.cli.output_paths import claim
from rpojax.cli.standard_streams import print_json
from rpojax.core.numerics.fibonacci_sphere import fibonacci_sphere
from rpojax.report.figures.landmark_picture import landmark_picture
from rpojax.runtime.progress import stage
from rpojax.scenario.plugins.command_lines import command_line
from rpojax.training.synthetic_data.meshes import mesh_files, packaged_target
from rpojax.untrusted.file_reading import FileError, FileKind
from rpojax.untrusted.json_reading import read_json
from rpojax.untrusted.structure_limits import StructureError
from rpojax.vision.surface.landmark_file import save_landmarks
from rpojax.vision.surface.landmark_selection import landmarks_at, select_landmarks
from rpojax.vision.surface.landmarks import LandmarkError, Landmarks, are_free
from rpojax.vision.surface.port_view import PortView

_DIRECTIONS = 1000
"""Viewing directions in which visible landmarks are counted."""


def landmarks(asked: LandmarksCommand) -> int:
    """Does the work of the command; returns its exit status."""
    claim(asked.out, asked.force)
    if asked.picture:
        claim(asked.picture, asked.force, (".png",))

    mesh = mesh_files.load_mesh(asked.mesh, asked.placement.units, asked.placement.center)
    show_lines(f"{asked.mesh}: {note}" for note in mesh.notes)
    triangles = np.concatenate([part.vertices[part.faces] for part in mesh.parts])
    port = _port(asked.port, asked.mesh == packaged_target.PACKAGED_TARGET)
    with stage("choosing landmarks", quiet=asked.as_json):
        if asked.points is None:
            found = select_landmarks(triangles, asked.count, port)
        else:
            found = landmarks_at(_read_points(asked.points), triangles, port)
    card = {"mesh": mesh.name, "command": _command(asked), **_summary(found, port)}
    save_landmarks(found, asked.out, card)
    if asked.picture:
        write_atomically(asked.picture, landmark_picture(triangles, found))
    shown = {"file": str(asked.out), **card}
    if asked.as_json:
        print_json({**shown, "positions_m": np.asarray(found.positions).tolist()})
    else:
        print("\n".join(f"{name}: {value}" for name, value in shown.items()))
    return 0


def _port(asked: PortOptions, is_packaged: bool) -> PortView | None:
    """Port of the options; by default that of the packaged target, and none of a mesh file."""
    position, axis = asked.port_position, asked.port_axis
    if position is None and is_packaged:
        position, axis = packaged_target.PORT_POSITION, packaged_target.PORT_AXIS
    if position is None or axis is None:
        return None
    view = math.radians(asked.port_fov_deg)
    return PortView(np.array(position), np.array(axis), asked.port_range, view, asked.port_landmarks)


def _read_points(path: Path) -> np.ndarray:
    """Places (n, 3) [m] of a JSON file.

    Raises:
        LandmarkError: it cannot be read, or holds something else.
    """
    expected = "a list of places [x, y, z] in m"
    try:
        points = np.array(read_json(path, FileKind.LANDMARKS), dtype=float)
    except FileError as error:
        raise LandmarkError(f"{path}: cannot be read ({error.found}), expected {error.expected}") from None
    except (StructureError, ValueError, TypeError):
        raise LandmarkError(f"{path}: found no {expected[2:]}, expected {expected}") from None
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise LandmarkError(f"{path}: found numbers of shape {points.shape}, expected {expected}")
    return points


def _summary(found: Landmarks, port: PortView | None) -> dict[str, Any]:
    """How many landmarks there are, how many of them are seen from all round, and how many are on the port's face."""
    counts = [
        int(are_free(found.visible, jnp.broadcast_to(direction, found.positions.shape)).sum())
        for direction in jnp.asarray(fibonacci_sphere(_DIRECTIONS).T)
    ]
    shown: dict[str, Any] = {
        "landmarks": len(found.positions),
        "visible_at_least": min(counts),
        "visible_median": float(np.median(counts)),
        "symmetries": len(found.symmetries),
    }
    if port is None:
        return shown
    places = (np.asarray(each) for each in (found.positions, found.normals, found.visible))
    return {
        **shown,
        "on_port_face": int(port.on_face(*places).sum()),
        "port_position_m": port.position.tolist(),
        "port_axis": port.unit_axis.tolist(),
    }


def _command(asked: LandmarksCommand) -> str:
    """The command with the names of its files, without paths of this machine."""
    given = ((field.name, getattr(asked.port, field.name), field.default) for field in fields(asked.port))
    port = [
        word
        for name, value, default in given
        if value != default
        for word in ("--" + name.replace("_", "-"), *(value if isinstance(value, tuple) else (value,)))
    ]
    words = [
        *(("--units", asked.placement.units) if asked.placement.units else ()),
        *(("--center",) if asked.placement.center else ()),
        *port,
        *(("--points", asked.points.name) if asked.points else ("--count", asked.count)),
    ]
    return command_line("landmarks", Path(asked.mesh).name, "--out", asked.out.name, *words, plugin=None)
