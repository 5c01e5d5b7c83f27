"""3-D scene of a recording in the Hill frame: both spacecraft, the estimate with its covariance, and the burns."""

import io
from collections.abc import Iterable, Iterator
from typing import Any

import jax.numpy as jnp
import numpy as np
import rerun as rr
from PIL import Image
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from rpojax.interop.rerun_viewer.rrd_chunks import RrdChunks, ServicerChunks, ViewerChannels
from rpojax.interop.run_replay import PosedImage, ReplayedRun
from rpojax.sensors import camera_pose
from rpojax.vision import pinhole

HILL = "hill"
SHARED = (f"{HILL}/axes", f"{HILL}/target")
"""Entities that are the same for all servicers of a team."""
SERVICER = f"{HILL}/servicer"
CAMERA = f"{SERVICER}/camera"

TRUE_COLOR = (86, 180, 233)
ESTIMATE_COLOR = (255, 138, 51)
ACCEPTED_COLOR = (47, 214, 163)
_BODY_COLOR = (150, 160, 175)
_TARGET_COLOR = (214, 170, 80)
_THRUST_COLOR = (255, 90, 60)
_KEEP_OUT_COLOR = (110, 118, 130)

_AXIS_LENGTH_M = 12.0
"""Length of the Hill axes."""
_THRUST_ARROW_M = 5.0
"""Length of the arrow of the nominal force."""
_IMAGE_PLANE_M = 4.0
"""Distance of the image plane from the camera in its frustum."""
_ESTIMATED_AXES_M = 2.2
"""Length of the target's axes by the estimate; the true ones are 1.5 m long."""
_SIGMAS = 3.0
_REJECTED_COLOR = (255, 138, 51)
_TRUE_OUTLINE_COLOR = (130, 138, 150)
_EMPTY_COLOR = (18, 20, 26)
_IMAGES_PER_CHUNK = 100
"""Encoded images in memory at once."""


def add_scene(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    """Adds the scene of a run."""
    chunks.add_static(HILL, rr.ViewCoordinates.RIGHT_HAND_X_UP)
    _add_reference_geometry(chunks, run)
    _add_target(chunks, run)
    _add_target_estimate(chunks, run)
    _add_servicer(chunks, run)
    _add_camera(chunks, run)
    _add_thrust(chunks, run)
    _add_estimate(chunks, run)


def attitude_matrices(q: np.ndarray) -> np.ndarray:
    """Direction cosine matrices (ticks, 3, 3) of scalar-first quaternions (ticks, 4)."""
    return Rotation.from_quat(np.roll(q.astype(np.float64), -1, axis=-1)).as_matrix()


def quaternion_to_parent(R: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4), scalar last, of matrices that turn a child's components into its parent's."""
    return Rotation.from_matrix(R).as_quat(canonical=True)


def ellipsoids(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half axes (ticks, 3) at 3 sigma and attitudes (ticks, 4), scalar last, of covariances (ticks, 3, 3)."""
    variances, axes = np.linalg.eigh(covariance)
    axes = axes * np.sign(np.linalg.det(axes))[:, None, None]
    return _SIGMAS * np.sqrt(np.maximum(variances, 0.0)), quaternion_to_parent(axes)


def mean_thrust(run: ReplayedRun[ViewerChannels]) -> np.ndarray:
    """Mean force [N] of the thruster from each tick to the next (ticks,)."""
    time, delta_v = run.time_s, run.values["delta_v_m_s"].astype(np.float64)
    if len(time) < 2:
        return np.zeros(len(time))
    mean = np.append(np.diff(delta_v) / np.diff(time), 0.0) * run.values["mass_kg"]
    # Smaller values are rounding of the channel.
    return np.where(mean > 1e-4 * float(run.params.plant.thruster.force), mean, 0.0)


def _add_reference_geometry(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    names = ("radial", "along-track", "orbit normal")
    chunks.add_static(
        f"{HILL}/axes",
        rr.Arrows3D(
            vectors=_AXIS_LENGTH_M * np.eye(3), colors=np.eye(3, dtype=np.uint8) * 200 + 55, labels=names, radii=0.03
        ),
    )
    desired = np.asarray(run.params.flight.formation.desired_position)
    chunks.add_static(
        f"{HILL}/desired", rr.Points3D([desired], colors=[ACCEPTED_COLOR], radii=[0.25], labels=["desired"])
    )
    keep_out = float(run.params.limits.keep_out)
    chunks.add_static(
        f"{HILL}/keep_out",
        rr.Ellipsoids3D(
            half_sizes=[[keep_out] * 3], colors=[_KEEP_OUT_COLOR], line_radii=[-0.5], fill_mode="majorwireframe"
        ),
    )


def _add_target(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    path, time = f"{HILL}/target", run.time_s
    R_HT = run.values["R_HN"] @ attitude_matrices(run.poses["q_TN"]).transpose(0, 2, 1)
    chunks.add(path, time, rr.Transform3D.columns(quaternion=quaternion_to_parent(R_HT)))
    chunks.add_static(path, rr.TransformAxes3D(1.5))
    hull = np.asarray(run.params.plant.target.true_hull)
    corners, normals = _hull_triangles(hull)
    triangles = np.arange(len(corners)).reshape(-1, 3)
    color = np.tile([*_TARGET_COLOR, 255], (len(corners), 1)).astype(np.uint8)
    mesh = rr.Mesh3D(vertex_positions=corners, triangle_indices=triangles, vertex_normals=normals, vertex_colors=color)
    chunks.add_static(f"{path}/hull", mesh)


def _add_target_estimate(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    """Adds the axes of the target by the estimate, longer than the true ones; of no length where it is not known."""
    estimate = run.values.get("q_TN_estimate")
    if estimate is None:
        return
    known = ~np.isnan(estimate[:, 0])
    q_TN = np.where(known[:, None], estimate, [1.0, 0.0, 0.0, 0.0])
    R_HT = run.values["R_HN"] @ attitude_matrices(q_TN).transpose(0, 2, 1)
    columns = (
        *rr.Transform3D.columns(quaternion=quaternion_to_parent(R_HT)),
        *rr.TransformAxes3D.columns(axis_length=np.where(known, _ESTIMATED_AXES_M, 0.0)),
    )
    chunks.add(f"{HILL}/target_estimate", run.time_s, columns)


def _hull_triangles(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners and outward normals (3 faces, 3) of the triangles of a convex hull, without shared corners."""
    hull = ConvexHull(vertices)
    corners = vertices[hull.simplices]
    normals = hull.equations[:, :3]
    turn = np.einsum("fi,fi->f", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), normals)
    corners[turn < 0.0] = corners[turn < 0.0][:, ::-1]
    return corners.reshape(-1, 3), np.repeat(normals, 3, axis=0)


def _add_servicer(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    rho_H = run.values["rho_H"]
    R_HB = run.values["R_HN"] @ attitude_matrices(run.poses["q_BN"]).transpose(0, 2, 1)
    chunks.add(SERVICER, run.time_s, rr.Transform3D.columns(translation=rho_H, quaternion=quaternion_to_parent(R_HB)))
    chunks.add_static(SERVICER, rr.TransformAxes3D(1.5))
    half = 0.5 * float(np.sqrt(run.params.plant.servicer_surface.area))
    body = rr.Boxes3D(half_sizes=[[half] * 3], colors=[_BODY_COLOR], fill_mode="solid")
    chunks.add_static(f"{SERVICER}/body", body)
    path = rr.LineStrips3D([rho_H], colors=[TRUE_COLOR], radii=[-1.0])
    chunks.add_static(f"{HILL}/true_path", path)


def _add_camera(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    size, camera = run.servicer_file.camera, run.params.camera
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], dtype=jnp.float64)
    R_KB = attitude_matrices(np.asarray(camera_pose.camera_attitude(camera, identity))[None])[0]
    mounting = rr.Transform3D(quaternion=rr.Quaternion(xyzw=quaternion_to_parent(R_KB.T)))
    fields: dict[str, Any] = {
        "resolution": [size.width_px, size.height_px],
        "camera_xyz": rr.ViewCoordinates.RDF,
        "image_plane_distance": _IMAGE_PLANE_M,
        "color": TRUE_COLOR,
    }
    own = _image_from_camera(camera.field_of_view, size.width_px, size.height_px)
    if run.params.wide_lens is None:
        fields["image_from_camera"] = own
    else:
        # What holds at all times hides what changes, so that the lens is left out of it.
        near = _image_from_camera(run.params.wide_lens.field_of_view, size.width_px, size.height_px)
        is_wide = np.asarray(run.values["wide_lens"], dtype=bool)
        lenses = np.where(is_wide[:, None, None], near, own)
        changes = np.concatenate([[True], is_wide[1:] != is_wide[:-1]])
        columns = rr.Pinhole.columns(image_from_camera=lenses[changes])
        chunks.add(CAMERA, run.time_s, columns.partition(changes.astype(int)))
    chunks.add_static(CAMERA, mounting, rr.Pinhole.from_fields(**fields))


def _image_from_camera(field_of_view: Any, width_px: int, height_px: int) -> np.ndarray:
    """Matrix (3, 3) from directions in the camera to places in its frame [px]."""
    lens = pinhole.pinhole_intrinsics(field_of_view, width_px, height_px)
    focal, (x, y) = float(lens.focal_px), np.asarray(lens.center_px)
    return np.array([[focal, 0.0, x], [0.0, focal, y], [0.0, 0.0, 1.0]])


def _add_thrust(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    """Adds an arrow along the force in every tick with a burn."""
    thruster, thrust_n = run.params.plant.thruster, mean_thrust(run)
    burning = thrust_n > 0.0
    direction = Rotation.from_rotvec(np.array(thruster.misalignment)).apply(np.array(thruster.direction))
    direction = direction / np.linalg.norm(direction)
    vectors = (_THRUST_ARROW_M / float(thruster.force) * thrust_n[burning])[:, None] * direction
    count = int(burning.sum())
    # The arrow ends at the nozzle.
    origins = np.asarray(thruster.position) - vectors
    columns = rr.Arrows3D.columns(
        vectors=vectors, origins=origins, colors=[_THRUST_COLOR] * count, radii=np.full(count, 0.08, dtype=np.float32)
    )
    chunks.add(f"{SERVICER}/thrust", run.time_s, columns.partition(burning.astype(int)))


def _add_estimate(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    """Adds the estimated position of the servicer with its 3-sigma ellipsoid."""
    time, estimate = run.time_s, run.values["rho_estimate_H"]
    half, turns = ellipsoids(run.values["relative_covariance_H"])
    columns = rr.Ellipsoids3D.columns(half_sizes=half, centers=estimate, quaternions=turns)
    path = f"{HILL}/estimate"
    chunks.add(f"{path}/sigma3", time, columns)
    chunks.add_static(
        f"{path}/sigma3",
        rr.Ellipsoids3D.from_fields(colors=[ESTIMATE_COLOR], line_radii=[-0.75], fill_mode="majorwireframe"),
    )
    chunks.add(path, time, rr.Points3D.columns(positions=estimate))
    chunks.add_static(path, rr.Points3D.from_fields(colors=[ESTIMATE_COLOR], radii=[0.15]))
    chunks.add_static(f"{HILL}/estimated_path", rr.LineStrips3D([estimate], colors=[ESTIMATE_COLOR], radii=[-0.75]))


def add_camera_view(
    chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels], images: Iterable[PosedImage] | None
) -> int:
    """Adds the boxes of every tick and the images of a rendered camera; returns the number of images."""
    size = (run.servicer_file.camera.width_px, run.servicer_file.camera.height_px)
    _add_boxes(chunks, run)
    if images is None:
        chunks.add_static(f"{CAMERA}/frame", _encoded_png(Image.new("RGB", size, _EMPTY_COLOR)))
        return 0
    count = 0
    for times, blobs in _encoded_batches(images, size):
        count += len(times)
        columns = rr.EncodedImage.columns(blob=blobs, media_type=["image/jpeg"] * len(blobs))
        chunks.add(f"{CAMERA}/picture", np.array(times), columns)
    return count


def window_in_frame(image: np.ndarray, window_px: np.ndarray, size: tuple[int, int]) -> Image.Image:
    """Frame (width, height), empty except for the image of a square window (left, top, side) [px]."""
    left, top, side = (float(value) for value in window_px)
    frame = Image.new("RGB", size, _EMPTY_COLOR)
    scaled = Image.fromarray(image).resize((round(side), round(side)), Image.Resampling.BOX)
    frame.paste(scaled, (round(left), round(top)))
    return frame


def _encoded_batches(images: Iterable[PosedImage], size: tuple[int, int]) -> Iterator[tuple[list[float], list[bytes]]]:
    times: list[float] = []
    blobs: list[bytes] = []
    for image, seen in images:
        buffer = io.BytesIO()
        window_in_frame(image, seen["window_px"], size).save(buffer, format="JPEG", quality=90, subsampling=0)
        times.append(float(seen["time_s"]))
        blobs.append(buffer.getvalue())
        if len(blobs) == _IMAGES_PER_CHUNK:
            yield times, blobs
            times, blobs = [], []
    if blobs:
        yield times, blobs


def _encoded_png(image: Image.Image) -> rr.EncodedImage:
    buffer = io.BytesIO()
    image.save(buffer, format="PNG")
    return rr.EncodedImage(contents=buffer.getvalue(), media_type="image/png")


def _add_boxes(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    channels = run.values
    present, accepted = channels["box_present"], channels["box_accepted"]
    color = np.where(accepted[:, None], ACCEPTED_COLOR, _REJECTED_COLOR).astype(np.uint8)[present]
    _add_box(chunks, run, "detected", present, *_centers_and_half_sizes(channels["box_px"]), color)
    outline = channels["outline_px"]
    visible = outline[:, 2:].min(axis=1) > 0.0
    _add_box(
        chunks,
        run,
        "true_outline",
        visible,
        *_centers_and_half_sizes(outline),
        np.array(_TRUE_OUTLINE_COLOR, dtype=np.uint8),
    )
    gate, center = channels["gate_px"], channels["expected_px"][:, :2]
    expected = np.isfinite(gate.sum(axis=1) + center.sum(axis=1))
    _add_box(chunks, run, "expected", expected, center, gate, np.array(TRUE_COLOR, dtype=np.uint8))


def _centers_and_half_sizes(boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centers and half sides of boxes (left, top, width, height)."""
    half = 0.5 * boxes[:, 2:]
    return boxes[:, :2] + half, half


def _add_box(
    chunks: RrdChunks | ServicerChunks,
    run: ReplayedRun[ViewerChannels],
    name: str,
    present: np.ndarray,
    center: np.ndarray,
    half_size: np.ndarray,
    color: np.ndarray,
) -> None:
    """Adds a box in the ticks where it is present."""
    count = int(present.sum())
    colors = np.broadcast_to(color, (count, 3))
    columns = rr.Boxes2D.columns(centers=center[present], half_sizes=half_size[present], colors=colors)
    chunks.add(f"{CAMERA}/{name}", run.time_s, columns.partition(present.astype(int)))
