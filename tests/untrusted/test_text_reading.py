"""Text in another encoding than UTF-8 is named as what it looks like, by each reader of text."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from rpojax.errors import RpojaxError
from rpojax.scenario.loading import case_table_csv, scenario_loader
from rpojax.scenario.plugins import plugin_file
from rpojax.training.public_data.data_formats import read_folder
from rpojax.training.synthetic_data.detection_dataset import read_dataset
from rpojax.training.synthetic_data.meshes import mesh_files
from rpojax.untrusted.json_reading import parse_json
from rpojax.untrusted.text_reading import EncodingError, decode_text

TEXT = 'extends = "inspection"\nname = "Prüfung"\n'


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (TEXT.encode("utf-16"), "looks like UTF-16"),
        (TEXT.encode("utf-16-le"), "looks like UTF-16"),
        (TEXT.encode("utf-16-be"), "looks like UTF-16"),
        (b"\xfe\xff" + TEXT.encode("utf-16-be"), "looks like UTF-16"),
        (TEXT.encode("utf-32"), "looks like UTF-32"),
        (TEXT.encode("utf-32-be"), "looks like UTF-32"),
        (TEXT.encode("latin-1"), "byte 0xFC in line 2, as in Latin-1"),
        (TEXT.encode("cp437"), "byte 0x81 in line 2, as in Latin-1"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "byte 0x89 in line 1, as in a binary file"),
        (b"name = 'a\0b'\n" + b"x" * 100, "zero bytes"),
    ],
)
def test_what_is_no_utf_8_is_named(content: bytes, found: str) -> None:
    with pytest.raises(EncodingError, match=found) as caught:
        decode_text(content)
    assert "no text in UTF-8" in caught.value.found


@pytest.mark.parametrize("content", [b"", b"a", b"ab", TEXT.encode(), "日本語 = 1\n".encode() * 9])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_utf_8_is_read_with_and_without_its_mark(content: bytes, mark: bytes) -> None:
    assert decode_text(mark + content) == content.decode()


def _table(path: Path) -> object:
    return case_table_csv.read_columns(path)


def _start(path: Path) -> object:
    tables = path.with_name("starts.toml")
    tables.write_text(f'extends = "inspection"\n[start]\ntarget = "{path.name}"\n')
    return scenario_loader.load(tables)


def _extended(path: Path) -> object:
    above = path.with_name("above.toml")
    above.write_text(f'extends = "{path.name}"\n')
    return scenario_loader.load(above)


def _spark(path: Path) -> object:
    return read_folder(path.parent, "spark", path)


def _yolo(path: Path) -> object:
    for part in ("images", "labels"):
        (path.parent / part).mkdir()
    (path.parent / "images" / "a.png").touch()
    path.rename(path.parent / "labels" / "a.txt")
    return read_folder(path.parent, "yolo")


READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "scenario": (TEXT, scenario_loader.load),
    "scenario that another one extends": (TEXT, _extended),
    "case table": ("gps.noise_m\n1\n", _table),
    "ephemeris": ("CCSDS_OEM_VERS = 2.0\n", _start),
    "element set": ("1 25544U 98067A   26079.61 0\n2 25544  51.6 0\n", _start),
    "plugin": ("def setup(): ...\n", lambda path: plugin_file.load(f"{path}:setup")),
    "SPARK table": ("filename,class,bbox\n", _spark),
    "YOLO labels": ("0 0.5 0.5 0.1 0.1\n", _yolo),
    "OBJ": ("v 0 0 0\n", lambda path: mesh_files.load_mesh(path.rename(path.with_suffix(".obj")))),
    "STL": ("solid x\nendsolid\n", lambda path: mesh_files.load_mesh(path.rename(path.with_suffix(".stl")))),
}


@pytest.mark.parametrize("name", READERS)
def test_each_reader_says_that_a_file_looks_like_utf_16(tmp_path: Path, name: str) -> None:
    text, read = READERS[name]
    path = tmp_path / "file.toml"
    path.write_text(text, encoding="utf-16")
    with pytest.raises(RpojaxError) as caught:
        read(path)
    message = str(caught.value)
    assert "did you mean" not in message
    assert "UTF-16" in message, message
    assert "\n" not in message


def test_a_material_library_in_utf_16_is_noted(tmp_path: Path) -> None:
    (tmp_path / "box.mtl").write_text("newmtl red\nKd 1 0 0\n", encoding="utf-16")
    (tmp_path / "box.obj").write_text("mtllib box.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.warns(mesh_files.MeshWarning, match="UTF-16"):
        mesh_files.load_mesh(tmp_path / "box.obj", center=True)


def test_json_is_read_in_utf_16_and_refused_in_latin_1(tmp_path: Path) -> None:
    # JSON is the one format of which UTF-16 can be told without a doubt.
    assert parse_json(json.dumps({"a": "ü"}, ensure_ascii=False).encode("utf-16")) == {"a": "ü"}
    with pytest.raises(RpojaxError, match="byte 0xFC in line 1, as in Latin-1"):
        parse_json('{"a": "ü"}'.encode("latin-1"))
    (tmp_path / "annotations.json").write_bytes('{"a": "ü"}'.encode("latin-1"))
    with pytest.raises(RpojaxError, match="as in Latin-1"):
        read_dataset(tmp_path)


def test_a_plugin_may_declare_its_encoding(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    text = "# -*- coding: latin-1 -*-\nimport rpojax\ndef setup():\n    'Prüfung'\n    return rpojax.Plugin()\n"
    path.write_text(text, encoding="latin-1")
    assert len(plugin_file.load(f"{path}:setup")[0]) == 64


def test_a_scenario_that_is_there_is_never_named_as_what_was_meant(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.symlink_to(tmp_path / "nowhere.toml")
    (tmp_path / "mine2.toml").write_text(TEXT)
    with pytest.raises(RpojaxError) as caught:
        scenario_loader.load(path)
    assert "did you mean 'mine.toml'" not in str(caught.value)
