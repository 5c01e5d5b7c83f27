"""The commands `rpojax pose`: one line for bad input with nothing written, and what a small training writes."""

import json
import shutil
from pathlib import Path

import pytest
import trimesh

from rpojax.cli import main


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two boxes, and the landmarks of one of them."""
    home = tmp_path_factory.mktemp("made")
    trimesh.creation.box(extents=(1.0, 0.6, 0.4)).export(home / "box.stl")
    trimesh.creation.box(extents=(0.6, 0.6, 0.6)).export(home / "cube.stl")
    assert run(f"landmarks {home}/box.stl --out {home}/box.landmarks --count 8") == main.Status.DONE
    return home


@pytest.fixture
def folder(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder of its own with these files."""
    for path in made.iterdir():
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(line: str) -> int:
    """Exit status of a command line."""
    return main.main(line.split())


_OF_BOX = "--mesh box.stl --landmarks box.landmarks"


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("train --out box.stl", "--force replaces it"),
        ("train --out new.file --mesh box.stl", "expected a mesh file with its landmarks, or neither"),
        ("train --out new.file --landmarks box.landmarks", "expected a mesh file with its landmarks, or neither"),
        ("train --out new.file --mesh nowhere.obj --landmarks box.landmarks", "no such file"),
        ("train --out new.file --mesh box.stl --landmarks nowhere.file", "nowhere.file: cannot be read"),
        ("train --out new.file --mesh box.stl --landmarks box.stl", "box.stl: cannot be read"),
        ("train --out new.file --mesh cube.stl --landmarks box.landmarks", "expected the landmarks of that mesh"),
        (f"train --out new.file {_OF_BOX} --range-m 0.5 10", "expected a camera outside of it"),
        ("train --out new.file --range-m 5 2", "expected two rising numbers"),
        ("train --out new.file --views 10", "expected at least 64 and 1"),
        ("train --out new.file --epochs 0", "expected at least 64 and 1"),
        ("train --out new.file --minutes 0", "expected a time above 0"),
        ("train --out new.file --rate 2", "expected a number between 0 and 1"),
        ("train --out new.file --seed -1", "expected 0 to 2147483647"),
        ("train --out new.file --start box.stl", "box.stl: cannot be read"),
        ("train --out box.stl/new.file", "expected a folder that can be written to"),
        ("evaluate nowhere.file --out new", "nowhere.file: cannot be read"),
        ("evaluate box.landmarks --out new", "box.landmarks: found kind 'rpojax landmarks 1'"),
        (f"evaluate --out new {_OF_BOX}", "found a network for other landmarks"),
        ("evaluate --out new --detector box.landmarks", "box.landmarks: found kind"),
        ("evaluate --out new --views 0", "expected at least 1"),
        ("evaluate --out box.stl", "box.stl"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    folder: Path, command: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    before = {path: path.read_bytes() for path in folder.rglob("*")}
    assert run(f"pose {command}") == main.Status.BAD_INPUT
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert expected in captured.err
    assert {path: path.read_bytes() for path in folder.rglob("*")} == before


@pytest.mark.slow
def test_a_small_training_writes_a_network_that_is_evaluated(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mitsuba")
    capsys.readouterr()
    assert run(f"pose train {_OF_BOX} --out box.pose --views 64 --epochs 1 --json") == main.Status.DONE
    written = json.loads(capsys.readouterr().out)
    assert written["command"] == (
        "rpojax pose train --out box.pose --mesh box.stl --landmarks box.landmarks "
        "--views 64 --epochs 1 --rate 0.005 --seed 0"
    )
    assert (written["landmarks"], written["views"], written["steps_done"]) == (8, 64, 3)
    evaluate = f"pose evaluate box.pose {_OF_BOX} --out judged --views 2 --samples 2 --json"
    assert run(evaluate) == main.Status.DONE
    found = json.loads(capsys.readouterr().out)
    assert found["network"] == written["command"]
    assert set(found["boxes"]) == {"detector", "jittered"}
    assert json.loads((folder / "judged" / "evaluation.json").read_text())["boxes"] == found["boxes"]
    assert run(evaluate) == main.Status.BAD_INPUT
    assert run(f"{evaluate} --force") == main.Status.DONE
