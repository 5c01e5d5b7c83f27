"""The three-dimensional scene of a run: both craft, the filter's belief and the burns, in the target's Hill frame."""

import jax.numpy as jnp
import numpy as np
import rerun as rr
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from rpojax.interop.rerun_viewer.data_columns import Chunks
from rpojax.interop.rerun_viewer.viewer_values import Shown
from rpojax.interop.run_replay import Flight
from rpojax.sensors import geometric_camera
from rpojax.vision import pinhole

HILL = "hill"
SERVICER = f"{HILL}/servicer"
CAMERA = f"{SERVICER}/camera"

TRUE = (86, 180, 233)
ESTIMATED = (255, 138, 51)
GREEN = (47, 214, 163)
_STEEL = (150, 160, 175)
_GOLD = (214, 170, 80)
_FLAME = (255, 90, 60)
_FAINT = (110, 118, 130)

_AXIS_M = 12.0
"""Length of the Hill axes."""
_THRUST_M = 5.0
"""Length of the arrow of the nominal force."""
_IMAGE_M = 4.0
"""From the camera to the picture in its frustum."""
_SIGMAS = 3.0


def add(chunks: Chunks, flight: Flight[Shown]) -> None:
    """Adds the scene of a run."""
    chunks.add_static(HILL, rr.ViewCoordinates.RIGHT_HAND_X_UP)
    _add_marks(chunks, flight)
    _add_target(chunks, flight)
    _add_servicer(chunks, flight)
    _add_camera(chunks, flight)
    _add_thrust(chunks, flight)
    _add_belief(chunks, flight)


def attitude(q: np.ndarray) -> np.ndarray:
    """Direction cosine matrices (ticks, 3, 3) of scalar-first quaternions (ticks, 4)."""
    return Rotation.from_quat(np.roll(q.astype(np.float64), -1, axis=-1)).as_matrix()


def to_parent(R: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4), scalar last, that turn a child's components into its parent's, of matrices that do."""
    return Rotation.from_matrix(R).as_quat(canonical=True)


def ellipsoids(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half axes (ticks, 3) at 3 sigma and attitudes (ticks, 4), scalar last, of covariances (ticks, 3, 3)."""
    variances, axes = np.linalg.eigh(covariance)
    axes = axes * np.sign(np.linalg.det(axes))[:, None, None]
    return _SIGMAS * np.sqrt(np.maximum(variances, 0.0)), to_parent(axes)


def force(flight: Flight[Shown]) -> np.ndarray:
    """Mean force [N] of the thruster from each tick to the next (ticks,)."""
    time, gained = flight.time_s, flight.values["delta_v_m_s"].astype(np.float64)
    if len(time) < 2:
        return np.zeros(len(time))
    mean = np.append(np.diff(gained) / np.diff(time), 0.0) * flight.values["mass_kg"]
    # Less is rounding of the channel.
    return np.where(mean > 1e-4 * float(flight.chosen.plant.thruster.force), mean, 0.0)


def _add_marks(chunks: Chunks, flight: Flight[Shown]) -> None:
    names = ("radial", "along-track", "orbit normal")
    chunks.add_static(
        f"{HILL}/axes",
        rr.Arrows3D(vectors=_AXIS_M * np.eye(3), colors=np.eye(3, dtype=np.uint8) * 200 + 55, labels=names, radii=0.03),
    )
    desired = flight.file.formation.desired_position_m
    chunks.add_static(f"{HILL}/desired", rr.Points3D([desired], colors=[GREEN], radii=[0.25], labels=["desired"]))
    keep_out = float(flight.chosen.limits.keep_out)
    chunks.add_static(
        f"{HILL}/keep_out",
        rr.Ellipsoids3D(half_sizes=[[keep_out] * 3], colors=[_FAINT], line_radii=[-0.5], fill_mode="majorwireframe"),
    )


def _add_target(chunks: Chunks, flight: Flight[Shown]) -> None:
    path, time = f"{HILL}/target", flight.time_s
    R_HT = flight.values["R_HN"] @ attitude(flight.poses["q_TN"]).transpose(0, 2, 1)
    chunks.add(path, time, rr.Transform3D.columns(quaternion=to_parent(R_HT)))
    chunks.add_static(path, rr.TransformAxes3D(1.5))
    hull = np.asarray(flight.chosen.plant.target.hull)
    corners, normals = _faces(hull)
    triangles = np.arange(len(corners)).reshape(-1, 3)
    color = np.tile([*_GOLD, 255], (len(corners), 1)).astype(np.uint8)
    mesh = rr.Mesh3D(vertex_positions=corners, triangle_indices=triangles, vertex_normals=normals, vertex_colors=color)
    chunks.add_static(f"{path}/hull", mesh)


def _faces(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners and outward normals (3 faces, 3) of the triangles of a convex hull, each with corners of its own."""
    hull = ConvexHull(vertices)
    corners = vertices[hull.simplices]
    normals = hull.equations[:, :3]
    turn = np.einsum("fi,fi->f", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), normals)
    corners[turn < 0.0] = corners[turn < 0.0][:, ::-1]
    return corners.reshape(-1, 3), np.repeat(normals, 3, axis=0)


def _add_servicer(chunks: Chunks, flight: Flight[Shown]) -> None:
    rho_H = flight.values["rho_H"]
    R_HB = flight.values["R_HN"] @ attitude(flight.poses["q_BN"]).transpose(0, 2, 1)
    chunks.add(SERVICER, flight.time_s, rr.Transform3D.columns(translation=rho_H, quaternion=to_parent(R_HB)))
    chunks.add_static(SERVICER, rr.TransformAxes3D(1.5))
    half = 0.5 * float(np.sqrt(flight.file.servicer_surface.area_m2))
    body = rr.Boxes3D(half_sizes=[[half] * 3], colors=[_STEEL], fill_mode="solid")
    chunks.add_static(f"{SERVICER}/body", body)
    path = rr.LineStrips3D([rho_H], colors=[TRUE], radii=[-1.0])
    chunks.add_static(f"{HILL}/true_path", path)


def _add_camera(chunks: Chunks, flight: Flight[Shown]) -> None:
    size, camera = flight.file.camera, flight.chosen.camera
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], dtype=jnp.float64)
    R_KB = attitude(np.asarray(geometric_camera.attitude(camera, identity))[None])[0]
    lens = pinhole.lens(camera.field_of_view, size.width_px, size.height_px)
    frustum = rr.Pinhole(
        resolution=[size.width_px, size.height_px],
        focal_length=float(lens.focal_px),
        principal_point=np.asarray(lens.center_px),
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=_IMAGE_M,
        color=TRUE,
    )
    chunks.add_static(CAMERA, rr.Transform3D(quaternion=rr.Quaternion(xyzw=to_parent(R_KB.T))), frustum)


def _add_thrust(chunks: Chunks, flight: Flight[Shown]) -> None:
    """An arrow along the force, where it acts, over every tick with a burn."""
    thruster, newton = flight.chosen.plant.thruster, force(flight)
    burning = newton > 0.0
    direction = Rotation.from_rotvec(np.array(thruster.misalignment)).apply(np.array(thruster.direction))
    direction = direction / np.linalg.norm(direction)
    vectors = (_THRUST_M / float(thruster.force) * newton[burning])[:, None] * direction
    count = int(burning.sum())
    # The arrow ends at the nozzle: it pushes.
    origins = np.asarray(thruster.position) - vectors
    columns = rr.Arrows3D.columns(
        vectors=vectors, origins=origins, colors=[_FLAME] * count, radii=np.full(count, 0.08, dtype=np.float32)
    )
    chunks.add(f"{SERVICER}/thrust", flight.time_s, columns.partition(burning.astype(int)))


def _add_belief(chunks: Chunks, flight: Flight[Shown]) -> None:
    """Where flight software believes the servicer to be, with an ellipsoid of 3 sigma."""
    time, estimate = flight.time_s, flight.values["rho_estimate_H"]
    half, turns = ellipsoids(flight.values["relative_covariance_H"])
    columns = rr.Ellipsoids3D.columns(half_sizes=half, centers=estimate, quaternions=turns)
    path = f"{HILL}/estimate"
    chunks.add(f"{path}/sigma3", time, columns)
    chunks.add_static(
        f"{path}/sigma3",
        rr.Ellipsoids3D.from_fields(colors=[ESTIMATED], line_radii=[-0.75], fill_mode="majorwireframe"),
    )
    chunks.add(path, time, rr.Points3D.columns(positions=estimate))
    chunks.add_static(path, rr.Points3D.from_fields(colors=[ESTIMATED], radii=[0.15]))
    chunks.add_static(f"{HILL}/estimated_path", rr.LineStrips3D([estimate], colors=[ESTIMATED], radii=[-0.75]))
