"""Rerun recordings hold the channels of the run, on simulation time alone."""

import dataclasses
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow as pa
import pytest
import rerun.chunk as rrc
from scipy.spatial.transform import Rotation
from synthetic_run import synthetic_run as make_synthetic_run

from rpojax.core.pytree import replace
from rpojax.errors import OutputError, RpojaxError
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.interop.rerun_viewer import rrd_recording, scene_3d, time_plots
from rpojax.interop.rerun_viewer.rrd_chunks import ViewerChannels
from rpojax.interop.run_replay import PosedImage, ReplayedRun
from rpojax.scenario.loading import scenario_loader
from rpojax.sensors.camera import WideLens

CAMERA = "/hill/servicer/camera"


class RecordingReader:
    """Recording read back: columns of an entity by name, one list of instances a row."""

    def __init__(self, path: Path) -> None:
        reader = rrc.RrdReader(path)
        self.stores = [(store.application_id, store.recording_id) for store in reader.recordings()]
        self.blueprints = len(reader.blueprints())
        self.batches: dict[tuple[str, bool], pa.RecordBatch] = {}
        for chunk in reader.stream().to_chunks():
            assert (chunk.entity_path, chunk.is_static) not in self.batches
            self.batches[chunk.entity_path, chunk.is_static] = chunk.to_record_batch()

    def column(self, path: str, name: str, static: bool = False) -> list[list]:
        """Instances of a component, row by row."""
        return self.batches[path, static].column(name).to_pylist()

    def only(self, path: str, name: str, static: bool = False) -> np.ndarray:
        """The one instance of each row."""
        rows = self.column(path, name, static)
        assert {len(row) for row in rows} == {1}
        return np.array([row[0] for row in rows], dtype=float)

    def time_s(self, path: str) -> np.ndarray:
        """Simulation time of the rows [s]."""
        return self.batches[path, False].column("sim_time").cast(pa.int64()).to_numpy() / 1e9


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., RecordingReader]:
    """Writes a run and reads it back."""

    def made(flight: ReplayedRun[ViewerChannels], shots: Iterable[PosedImage] | None = None) -> RecordingReader:
        return RecordingReader(rrd_recording.write_recording(flight, tmp_path / "run.rrd", shots).path)

    return made


@pytest.fixture
def read(write: Callable[..., RecordingReader], synthetic_run: ReplayedRun[ViewerChannels]) -> RecordingReader:
    return write(synthetic_run)


def test_the_only_timeline_is_simulation_time(
    read: RecordingReader, synthetic_run: ReplayedRun[ViewerChannels]
) -> None:
    for (path, static), batch in read.batches.items():
        indices = [field.name for field in batch.schema if (field.metadata or {}).get(b"rerun:kind") == b"index"]
        assert indices == ([] if static else ["sim_time"]), path
    np.testing.assert_array_equal(read.time_s("/hill/servicer"), synthetic_run.time_s)


def test_row_ids_are_counted(read: RecordingReader) -> None:
    rows = [batch.column(0).to_pylist() for batch in read.batches.values()]
    highest = max(int.from_bytes(row, "big") >> 64 for column in rows for row in column)
    assert highest == len(read.batches)


def test_the_same_run_gives_equal_content(
    read: RecordingReader, write: Callable[..., RecordingReader], synthetic_run: ReplayedRun[ViewerChannels]
) -> None:
    again = write(synthetic_run)
    assert read.stores == again.stores
    assert read.batches.keys() == again.batches.keys()
    assert all(batch.equals(again.batches[key]) for key, batch in read.batches.items())


def test_the_file_has_a_blueprint_and_names_the_run(read: RecordingReader) -> None:
    assert read.blueprints == 1
    [(application, recording)] = read.stores
    assert application == "rpojax"
    assert recording.endswith("-seed1-run4")
    assert read.column("/__properties/RecordingInfo", "RecordingInfo:name", True) == [["inspection, seed 1, run 4"]]


def test_true_and_estimated_positions_are_those_of_the_channels(
    read: RecordingReader, synthetic_run: ReplayedRun[ViewerChannels]
) -> None:
    for path, name, channel in (
        ("/hill/servicer", "Transform3D:translation", "rho_H"),
        ("/hill/estimate", "Points3D:positions", "rho_estimate_H"),
    ):
        np.testing.assert_allclose(read.only(path, name), synthetic_run.values[channel], atol=1e-5)


def test_the_chain_of_poses_puts_the_target_at_the_image_center(
    read: RecordingReader, synthetic_run: ReplayedRun[ViewerChannels]
) -> None:
    """Servicer, camera and pinhole as the viewer composes them, with the camera pointing at the target."""
    R_HB = Rotation.from_quat(read.only("/hill/servicer", "Transform3D:quaternion"))
    R_BK = Rotation.from_quat(read.only(CAMERA, "Transform3D:quaternion", True)[0])
    target_K = R_BK.inv().apply(R_HB.inv().apply(-read.only("/hill/servicer", "Transform3D:translation")))
    lens = read.only(CAMERA, "Pinhole:image_from_camera", True)[0].reshape(3, 3).T
    pixel = target_K @ lens.T
    np.testing.assert_allclose(pixel[:, :2] / pixel[:, 2:], [[64.0, 64.0]] * synthetic_run.ticks, atol=1e-3)
    assert (target_K[:, 2] > 0.0).all()
    assert read.column(CAMERA, "Pinhole:resolution", True) == [[[128.0, 128.0]]]
    # The image's right is the orbit normal.
    right_H = R_HB.apply(R_BK.apply([1.0, 0.0, 0.0]))
    assert (right_H[:, 2] > 0.99).all()


def test_the_lens_is_that_of_the_frame(write: Callable[..., RecordingReader]) -> None:
    run = make_synthetic_run()
    angles = float(run.params.camera.field_of_view) * np.array([1.0, 2.0])
    lens = WideLens(field_of_view=jnp.asarray(angles[1]), misalignment=jnp.zeros(3))
    values = {**run.values, "wide_lens": np.arange(run.ticks) >= 3}
    read = write(dataclasses.replace(run, params=replace(run.params, wide_lens=lens), values=values))
    found = np.array([row[0] for row in read.column(CAMERA, "Pinhole:image_from_camera") if row])
    np.testing.assert_allclose(found[:, 0], 64.0 / np.tan(0.5 * angles), rtol=1e-6)
    assert "Pinhole:image_from_camera" not in read.batches[CAMERA, True].schema.names


def test_the_target_attitude_in_the_hill_frame_combines_tumble_and_orbit(
    read: RecordingReader, synthetic_run: ReplayedRun[ViewerChannels]
) -> None:
    R_HT = Rotation.from_quat(read.only("/hill/target", "Transform3D:quaternion")).as_matrix()
    R_TN = scene_3d.attitude_matrices(synthetic_run.poses["q_TN"])
    np.testing.assert_allclose(R_HT @ R_TN, synthetic_run.values["R_HN"], atol=1e-6)
    # It began along the Hill axes and turns about x by 1 deg/s.
    np.testing.assert_allclose(R_HT[30] @ [0.0, 1.0, 0.0], [0.0, np.cos(np.pi / 6), np.sin(np.pi / 6)], atol=1e-6)


def test_normals_of_the_target_hull_point_outward(read: RecordingReader) -> None:
    corners = np.array(read.column("/hill/target/hull", "Mesh3D:vertex_positions", True)[0]).reshape(-1, 3, 3)
    normals = np.array(read.column("/hill/target/hull", "Mesh3D:vertex_normals", True)[0]).reshape(-1, 3, 3)
    turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("fi,fi->f", turned, normals[:, 0]) > 0.0).all()
    assert (np.einsum("fci,fci->fc", corners, normals) > 0.0).all()


def test_the_ellipsoid_is_the_covariance_at_three_sigma(
    read: RecordingReader, synthetic_run: ReplayedRun[ViewerChannels]
) -> None:
    half = read.only("/hill/estimate/sigma3", "Ellipsoids3D:half_sizes")
    turns = Rotation.from_quat(read.only("/hill/estimate/sigma3", "Ellipsoids3D:quaternions")).as_matrix()
    found = np.einsum("tij,tj,tkj->tik", turns, (half / 3.0) ** 2, turns)
    np.testing.assert_allclose(found, synthetic_run.values["relative_covariance_H"], rtol=1e-4, atol=1e-6)
    assert np.abs(found[:, 0, 1]).min() > 1e-4


def test_the_thrust_arrow_is_there_during_the_burn_only(
    read: RecordingReader, synthetic_run: ReplayedRun[ViewerChannels]
) -> None:
    vectors = read.column("/hill/servicer/thrust", "Arrows3D:vectors")
    assert [tick for tick, there in enumerate(vectors) if there] == [20, 21, 22, 23]
    # 1 mm/s in a second on 30 kg is the nominal force of 30 mN along x of the body: five metres.
    np.testing.assert_allclose(vectors[21], [[5.0, 0.0, 0.0]], rtol=1e-5)
    np.testing.assert_allclose(read.column("/hill/servicer/thrust", "Arrows3D:origins")[21], [[-5.25, 0.0, 0.0]])


def test_boxes_are_there_when_detected_and_coloured_by_acceptance(read: RecordingReader) -> None:
    centers, colors = (read.column(f"{CAMERA}/detected", f"Boxes2D:{name}") for name in ("centers", "colors"))
    assert [tick for tick, there in enumerate(centers) if not there] == [5]
    assert centers[0] == [[64.0, 64.0]]
    assert read.column(f"{CAMERA}/detected", "Boxes2D:half_sizes")[0] == [[14.0, 10.0]]
    assert [tick for tick, color in enumerate(colors) if color and color != colors[0]] == [7]
    assert read.column(f"{CAMERA}/expected", "Boxes2D:half_sizes")[:6] == [[[6.0, 7.0]]] * 5 + [[]]
    assert read.column(f"{CAMERA}/true_outline", "Boxes2D:centers")[0] == [[65.5, 65.5]]


def test_plots_hold_the_channels_in_their_units(
    read: RecordingReader, synthetic_run: ReplayedRun[ViewerChannels]
) -> None:
    error = read.column("/plots/estimation_error/along_track", "Scalars:scalars")
    seen = synthetic_run.values
    # As in the scene: the estimated position of the servicer minus the true one, between its bounds.
    np.testing.assert_allclose([row[0] for row in error], (seen["rho_estimate_H"] - seen["rho_H"])[:, 1], atol=1e-6)
    np.testing.assert_allclose([row[1:] for row in error], 3.0 * seen["relative_sigma_H"][:, 1:2] * [1.0, -1.0])
    distance = np.linalg.norm(seen["rho_H"] - [0.0, -30.0, 0.0], axis=1)
    np.testing.assert_allclose(read.only("/plots/formation_error", "Scalars:scalars"), distance)
    speed = np.array(read.column("/plots/wheel_speed", "Scalars:scalars"))
    torque = np.array(read.column("/plots/wheel_torque", "Scalars:scalars"))
    np.testing.assert_allclose(speed, 628.0 * seen["wheel_speed_fraction"])
    np.testing.assert_allclose(torque, 1e3 * 0.0008 * np.diff(speed, axis=0))
    plotted = {path for path, static in read.batches if path.startswith("/plots/") and not static}
    assert plotted == {f"/plots/{plot.name}" for plot in time_plots.run_plots(synthetic_run)} | {"/plots/mode"}


def test_the_mode_has_a_row_at_each_change(read: RecordingReader) -> None:
    assert read.time_s("/plots/mode").tolist() == [0.0, 20.0, 24.0]
    assert read.column("/plots/mode", "StateChange:state") == [["look"], ["burn"], ["look"]]
    assert set(time_plots.MODE_STYLES) == set(Mode)


def test_a_camera_without_images_has_an_empty_frame_of_its_size(write: Callable[..., RecordingReader]) -> None:
    read = write(make_synthetic_run("camera.width_px=96", "camera.height_px=64"))
    picture = _decoded(read.column(f"{CAMERA}/frame", "EncodedImage:blob", True)[0][0])
    assert picture.shape == (64, 96, 3)
    assert np.ptp(picture.reshape(-1, 3), axis=0).max() == 0


def test_a_window_image_is_placed_in_the_frame(write: Callable[..., RecordingReader]) -> None:
    flight = make_synthetic_run("camera.width_px=320", "camera.height_px=240")
    bright = np.full((128, 128, 3), 250, np.uint8)

    def shots() -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
        for tick in (0, 10):
            yield bright, {"time_s": np.array(float(tick)), "window_px": np.array([40.0, 20.0, 160.0])}

    read = write(flight, shots())
    assert read.time_s(f"{CAMERA}/picture").tolist() == [0.0, 10.0]
    picture = _decoded(read.column(f"{CAMERA}/picture", "EncodedImage:blob")[1][0])
    assert picture.shape == (240, 320, 3)
    rows, columns = np.nonzero(picture[..., 0] > 128)
    assert (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1) == (40, 20, 200, 180)
    assert (f"{CAMERA}/frame", True) not in read.batches


def _decoded(blob: list[int] | bytes) -> np.ndarray:
    import cv2

    return cv2.imdecode(np.array(bytearray(blob), np.uint8), cv2.IMREAD_COLOR)


def test_a_run_of_one_tick_can_be_written(
    write: Callable[..., RecordingReader], synthetic_run: ReplayedRun[ViewerChannels]
) -> None:
    values, poses = jax.tree.map(lambda each: each[:1], (synthetic_run.values, synthetic_run.poses))
    short = dataclasses.replace(synthetic_run, values=values, poses=poses)
    assert len(write(short).time_s("/hill/servicer")) == 1


def test_an_unwritable_path_is_named_and_no_file_is_left(
    synthetic_run: ReplayedRun[ViewerChannels], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"found .*, expected a file that can be written"):
        rrd_recording.write_recording(synthetic_run, tmp_path / "file" / "run.rrd")

    def broken() -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
        raise RpojaxError("no more")
        yield

    with pytest.raises(RpojaxError, match="no more"):
        rrd_recording.write_recording(synthetic_run, tmp_path / "run.rrd", broken())
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_missing_package_is_named_with_its_extra(
    synthetic_run: ReplayedRun[ViewerChannels], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(RpojaxError, match=r"^rerun: not installed, expected: pip install 'rpojax\[viz\]'$"):
        rrd_recording.write_recording(synthetic_run, tmp_path / "run.rrd")


def test_servicers_of_a_team_share_one_scene(tmp_path: Path, synthetic_run: ReplayedRun[ViewerChannels]) -> None:
    file = scenario_loader.load("cooperative_far")
    runs = [dataclasses.replace(synthetic_run, file=file, servicer=number) for number in range(2)]
    written = rrd_recording.write_servicers(runs, tmp_path / "team.rrd", [None, None])
    read = RecordingReader(written.path)
    paths = {path for path, _ in read.batches}
    assert {f"/hill/{name}/servicer/camera/frame" for name in ("first", "second")} <= paths
    assert {
        "/hill/first/true_path",
        "/hill/second/estimated_path",
        "/hill/target",
        "/hill/first/keep_out",
        "/hill/second/keep_out",
    } <= paths
    assert not {"/hill/servicer", "/hill/first/target", "/plots/mode"} & paths
    assert any(path.startswith("/plots/second/") for path in paths)
