"""The command `rpojax landmarks`: what it writes and prints, and one line for bad input with nothing written."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from rpojax.cli import main
from rpojax.training.synthetic_data.meshes import packaged_target
from rpojax.vision.surface.landmark_file import load_landmarks


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a box, a ball, and lists of places."""
    trimesh.creation.box(extents=(1.0, 0.6, 0.4)).export(tmp_path / "box.stl")
    trimesh.creation.box(extents=(1000.0, 600.0, 400.0)).apply_translation((900.0, 0.0, 0.0)).export(
        tmp_path / "far_mm.stl"
    )
    trimesh.creation.icosphere(subdivisions=2, radius=0.5).export(tmp_path / "ball.stl")
    (tmp_path / "inside.json").write_text(json.dumps([[0.1 * i, 0.0, 0.0] for i in range(6)]))
    (tmp_path / "words.json").write_text('["a", "b"]')
    (tmp_path / "flat.json").write_text("[1.0, 2.0, 3.0]")
    (tmp_path / "cut.json").write_text("[[1.0, ")
    places = [[0.5, y, z] for y in (-0.3, 0.0, 0.3) for z in (-0.2, 0.2)]
    (tmp_path / "places.json").write_text(json.dumps(places))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(line: str) -> int:
    """Exit status of a command line."""
    return main.main(line.split())


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("nowhere.obj --out new.file", "no such file"),
        ("ball.stl --out new.file", "mesh: found 0 corners"),
        ("box.stl --out box.stl", "--force replaces it"),
        ("box.stl --out new.file --picture new.jpg", "expected .png"),
        ("box.stl --out new.file --picture box.stl", "expected .png"),
        ("box.stl --out new.file --units parsec", "--units: found 'parsec'"),
        ("--out new.file --units mm", "expected only with a mesh file"),
        ("box.stl --out new.file --count 3", "--count: found 3, expected 6 to 64"),
        ("box.stl --out new.file --port-axis 1 0 0", "--port-position, --port-axis: found one of them"),
        ("box.stl --out new.file --port-position 0 0 0 --port-axis 1 0 0", "a place 0.2 m from the surface"),
        ("box.stl --out new.file --port-position 0.5 0 0 --port-axis -1 0 0", "an axis that meets the body"),
        ("box.stl --out new.file --port-position 0.5 0 0 --port-axis 1 0 0", "found 4 corners on its face"),
        ("box.stl --out new.file --port-position 0.5 0 0 --port-axis 1 0 0 --port-range 0.4", "found 0.4 m, expected"),
        ("box.stl --out new.file --port-position 0.5 0 0 --port-axis 1 0 0 --port-fov-deg 190", "expected 0 to 170"),
        ("box.stl --out new.file --points inside.json", "at 0.2 m from the surface, expected it on it"),
        ("box.stl --out new.file --points words.json", "words.json: found no list of places"),
        ("box.stl --out new.file --points flat.json", "flat.json: found numbers of shape (3,)"),
        ("box.stl --out new.file --points cut.json", "cut.json: found no list of places"),
        ("box.stl --out new.file --points nowhere.json", "nowhere.json: cannot be read"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    folder: Path, command: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path: path.read_bytes() for path in folder.rglob("*")}
    assert run(f"landmarks {command}") == main.Status.BAD_INPUT
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = [line for line in captured.err.splitlines() if "choosing" not in line]
    assert len(lines) == 1
    assert expected in lines[0]
    assert {path: path.read_bytes() for path in folder.rglob("*")} == before


def test_the_packaged_file_is_what_the_command_writes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("landmarks --out target.landmarks.safetensors --picture seen.png --json") == main.Status.DONE
    shown = json.loads(capsys.readouterr().out)
    (found, card), (packaged, packaged_card) = load_landmarks(folder / "target.landmarks.safetensors"), load_landmarks()
    assert card == packaged_card
    np.testing.assert_allclose(found.positions, packaged.positions, atol=1e-12)
    # Rays that graze an edge may differ by rounding.
    assert np.mean(np.asarray(found.visible) != np.asarray(packaged.visible)) < 1e-3
    np.testing.assert_array_equal(found.port_position, packaged_target.PORT_POSITION)
    assert shown["positions_m"] == np.asarray(found.positions).tolist()
    assert (shown["landmarks"], shown["symmetries"]) == (20, 1)
    assert 8 <= shown["visible_at_least"] <= shown["visible_median"] <= 20
    assert shown["on_port_face"] >= 8
    picture = cv2.imread(str(folder / "seen.png"))
    assert picture is not None
    assert picture.std() > 20.0


def test_the_file_says_which_port_was_asked_for(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    port = "--port-position 0.5 0.0 0.0 --port-axis 2.0 0.0 0.0 --port-range 2.0 --port-landmarks 4"
    assert run(f"landmarks box.stl --out new.file {port} --json") == main.Status.DONE
    shown = json.loads(capsys.readouterr().out)
    found, card = load_landmarks(folder / "new.file")
    assert card["command"] == f"rpojax landmarks box.stl --out new.file {port} --count 20"
    assert shown["on_port_face"] == 4
    np.testing.assert_allclose(found.port_axis, [1.0, 0.0, 0.0])


def test_a_mesh_in_other_units_is_moved_and_has_no_port(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("landmarks far_mm.stl --units mm --center --out new.file --count 8") == main.Status.DONE
    printed = dict(line.split(": ", 1) for line in capsys.readouterr().out.splitlines())
    assert printed["command"] == "rpojax landmarks far_mm.stl --out new.file --units mm --center --count 8"
    assert printed["symmetries"] == "4"
    assert "on_port_face" not in printed
    found = load_landmarks(folder / "new.file")[0]
    np.testing.assert_allclose(np.abs(found.positions), np.tile([0.5, 0.3, 0.2], (8, 1)), atol=1e-6)
    assert found.port_position is None


def test_places_of_a_user_are_taken_as_they_are(folder: Path) -> None:
    assert run("landmarks box.stl --points places.json --out new.file") == main.Status.DONE
    found = load_landmarks(folder / "new.file")[0]
    np.testing.assert_allclose(found.positions, json.loads((folder / "places.json").read_text()), atol=1e-12)
    # In the middle of an edge the normal is between those of its two faces.
    np.testing.assert_allclose(found.normals[2], [0.5**0.5, 0.0, -(0.5**0.5)], atol=0.05)
