"""3-D scene of a recording in the Hill frame: both spacecraft, the estimate with its covariance, and the burns."""

import jax.numpy as jnp
import numpy as np
import rerun as rr
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from rpojax.interop.rerun_viewer.rrd_chunks import RrdChunks, ServicerChunks
from rpojax.interop.rerun_viewer.viewer_channels import ViewerChannels
from rpojax.interop.run_replay import ReplayedRun
from rpojax.sensors import camera_pose
from rpojax.vision import pinhole

HILL = "hill"
SHARED = (f"{HILL}/axes", f"{HILL}/keep_out", f"{HILL}/target")
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
_SIGMAS = 3.0


def add_scene(chunks: RrdChunks | ServicerChunks, run: ReplayedRun[ViewerChannels]) -> None:
    """Adds the scene of a run."""
    chunks.add_static(HILL, rr.ViewCoordinates.RIGHT_HAND_X_UP)
    _add_reference_geometry(chunks, run)
    _add_target(chunks, run)
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
    lens = pinhole.pinhole_intrinsics(camera.field_of_view, size.width_px, size.height_px)
    frustum = rr.Pinhole(
        resolution=[size.width_px, size.height_px],
        focal_length=float(lens.focal_px),
        principal_point=np.asarray(lens.center_px),
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=_IMAGE_PLANE_M,
        color=TRUE_COLOR,
    )
    chunks.add_static(CAMERA, rr.Transform3D(quaternion=rr.Quaternion(xyzw=quaternion_to_parent(R_KB.T))), frustum)


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
