"""The verbs of `rpojax field`: pictures that can be opened, one line for bad input, and nothing half-written."""

import sys
from pathlib import Path

import cv2
import jax
import numpy as np
import pytest
import trimesh

from rpojax.cli import main
from rpojax.training.synthetic_data import ray_traced_views
from rpojax.vision.radiance_field.field_file import load_field, save_field
from rpojax.vision.radiance_field.initial_grid import initialize_grid
from rpojax.vision.weight_files import write_tensors


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a mesh, an untrained field and files that are neither."""
    trimesh.creation.box(extents=(1.0, 0.6, 0.4)).export(tmp_path / "box.stl")
    (tmp_path / "empty.stl").write_text("solid x\nendsolid x\n")
    points = np.random.default_rng(0).normal(size=(20_000, 3))
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    save_field(initialize_grid(0.5 * normals, normals, jax.random.key(0), 2000), tmp_path / "ball.field", {})
    (tmp_path / "cut.field").write_bytes((tmp_path / "ball.field").read_bytes()[:5000])
    write_tensors(tmp_path / "foreign.field", {"a": np.zeros(2)}, {})
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(line: str) -> int:
    """Exit status of a command line."""
    return main.main(line.split())


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("train empty.stl --out new.field", "found no triangles"),
        ("train nowhere.obj --out new.field", "no such file"),
        ("train box.stl --units parsec --out new.field", "--units: found 'parsec'"),
        ("train target --units mm --out new.field", "expected only with a mesh file"),
        ("train box.stl --views 3 --out new.field", "at least 16 views"),
        ("train box.stl --seed -1 --out new.field", "--seed: found -1"),
        ("train box.stl --minutes 0 --out new.field", "--minutes: found 0"),
        ("train box.stl --out ball.field", "--force replaces it"),
        ("train box.stl --out . --force", "found a folder"),
        ("train box.stl --out box.stl/new.field", "expected a folder that can be written to"),
        ("evaluate cut.field", "cannot be read"),
        ("evaluate foreign.field", "found kind"),
        ("evaluate nowhere.field", "cannot be read"),
        ("evaluate --views 1 --sheet new.jpg", "expected .png"),
        ("evaluate --views 1 --range-m 0.5", "--range-m: found a range of 0.5 m"),
        ("evaluate --views 1 --fov-deg 120", "--fov-deg: found a range"),
        ("evaluate --json --views 1 --samples 1 --range-m 9000", "covers no pixel"),
        ("evaluate ball.field", "--mesh: missing"),
        ("evaluate --mesh box.stl", "expected the mesh of the field"),
        ("render --out new.png --elevation-deg 500", "--elevation-deg, --azimuth-deg: found 500"),
        ("render --out new.png --azimuth-deg nan", "found 25.0, nan"),
        ("evaluate --views 1 --fov-deg 180", "--fov-deg: found 180"),
        ("render cut.field --out new.png", "cannot be read"),
        ("render --out new.gif", "expected .png or .mp4"),
        ("render --out box.stl/new.mp4", "expected a folder that can be written to"),
        ("render --out new.png --frames 65", "expected 1 to 64"),
        ("render --out new.png --sun 0 0 0", "expected a direction"),
        ("render --out new.png --sun nan 0 0", "expected a direction"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    folder: Path, command: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(folder.rglob("*"))
    assert run(f"field {command}") == main.Status.BAD_INPUT
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith("rpojax: error: ")
    assert expected in line
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("name", ["mitsuba"])
def test_a_missing_ray_tracer_is_one_line_and_writes_nothing(
    folder: Path, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    before = sorted(folder.rglob("*"))
    assert main.main(["field", "train", "box.stl", "--out", "new.field"]) == main.Status.BAD_INPUT
    [line] = capsys.readouterr().err.splitlines()
    assert line == f"rpojax: error: {name}: not installed, expected: pip install 'rpojax[raytrace]'"
    assert sorted(folder.rglob("*")) == before


def test_an_interrupt_says_that_the_same_command_goes_on(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    traced: list[int] = []

    def frame(tracer: object, rotation: object, position: object, sun: object, fill: object, seed: int) -> np.ndarray:
        traced.append(seed)
        if len(traced) == 40:
            raise KeyboardInterrupt
        return np.zeros((128, 128, 8), np.float32)

    monkeypatch.setattr(ray_traced_views.RayTracer, "trace", frame)
    assert main.main(["field", "train", "box.stl", "--out", "new.field", "--views", "48"]) == main.Status.INTERRUPTED
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1] == "rpojax: interrupted; the same command goes on from new.field.work"
    work = folder / "new.field.work"
    # The first 32 views are kept, and can be seen before there is a field.
    assert sorted(path.name for path in work.iterdir()) == ["contact_sheet.png", "views_00000.npz"]
    assert f"rpojax: first views: {Path('new.field.work') / 'contact_sheet.png'}" in lines
    assert not (folder / "new.field").exists()


def test_a_still_and_a_sheet_show_the_target_before_a_backdrop(folder: Path) -> None:
    assert run("field render ball.field --out still.png --size-px 64") == main.Status.DONE
    still = cv2.imread(str(folder / "still.png"))
    assert still is not None
    assert still.shape == (64, 64, 3)
    # No side of the target is as dark as what is behind it, nor is that black.
    assert 20 < still[0, 0, 0] < 60
    assert abs(int(still[32, 32].max()) - int(still[0, 0, 0])) > 10
    assert run("field render ball.field --out sheet.png --size-px 64 --frames 5") == main.Status.DONE
    sheet = cv2.imread(str(folder / "sheet.png"))
    assert sheet is not None
    assert sheet.shape[1] >= 3 * 64
    assert sheet.shape[0] >= 2 * 64


def test_a_turntable_is_a_film_of_all_its_frames(folder: Path) -> None:
    assert run("field render ball.field --out turn.mp4 --size-px 64 --frames 6") == main.Status.DONE
    film = cv2.VideoCapture(str(folder / "turn.mp4"))
    frames = []
    while (read := film.read())[0]:
        frames.append(read[1])
    assert len(frames) == 6
    assert frames[0].shape == (64, 64, 3)
    assert np.abs(frames[0].astype(float) - frames[3]).max() > 10
    assert not list(folder.glob("turn.mp4.*"))


@pytest.mark.slow
def test_a_mesh_becomes_a_field_that_can_be_judged_and_shown(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("field train box.stl --out box.field --views 40 --steps 250 --json") == main.Status.DONE
    _, card = load_field(folder / "box.field")
    assert card["command"] == ("rpojax field train box.stl --out box.field --kind grid --views 40 --steps 250 --seed 0")
    capsys.readouterr()
    command = "field evaluate box.field --mesh box.stl --views 4 --samples 16 --sheet judged.png --json"
    assert run(command) == main.Status.DONE
    assert '"psnr_db"' in capsys.readouterr().out
    assert (folder / "judged.png").is_file()
