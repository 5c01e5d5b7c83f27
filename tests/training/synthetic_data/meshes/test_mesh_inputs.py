"""Mesh files as other tools write them: what they say is used, named in a note, or refused in one line."""

import json
import struct
import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from rpojax.errors import RpojaxError
from rpojax.training.synthetic_data.meshes.mesh_files import MeshError, load_mesh
from rpojax.training.synthetic_data.meshes.target_mesh import TargetMesh

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
RED, DULL = (0.9, 0.0002, 0.0002), 0.0002
"""Linear red within the limits of reflection."""


def read(path: Path) -> TargetMesh:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_mesh(path, center=True)


def area(mesh: TargetMesh) -> float:
    total = 0.0
    for part in mesh.parts:
        a, b, c = (part.vertices[part.faces[:, corner]] for corner in range(3))
        total += 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    return total


def glb(path: Path, arrays: dict[str, np.ndarray], content: dict[str, Any] | None = None, **primitive: Any) -> Path:
    """A triangle as glTF with these attributes, its material and further JSON."""
    kinds = {"f": 5126, "B": 5121, "H": 5123}
    accessors, views, binary = [], [], b""
    for values in (TRIANGLE, *arrays.values()):
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes})
        kind = kinds[values.dtype.char]
        accessor = {"bufferView": len(views) - 1, "componentType": kind, "count": 3, "type": f"VEC{values.shape[1]}"}
        accessors.append(accessor | ({"normalized": True} if kind != 5126 else {}))
        binary += values.tobytes() + b"\0" * (-values.nbytes % 4)
    attributes = {"POSITION": 0} | {name: number for number, name in enumerate(arrays, start=1)}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, **primitive}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    } | (content or {})
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary))
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    path.write_bytes(head + chunks)
    return path


def material(**values: Any) -> dict[str, Any]:
    return {"materials": [values]}


RED_VERTICES = {"COLOR_0": np.tile(np.array([1, 0, 0], "<f4"), (3, 1))}
POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 36\n"
IDENTITY = np.eye(4).ravel().tolist()
ROW_BY_ROW = [1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
WHITE = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1]}}


@pytest.mark.parametrize(
    ("arrays", "content", "color"),
    [
        (RED_VERTICES, material(**WHITE), RED),  # colours of vertices multiply that of the material
        (RED_VERTICES, material(name="plain"), RED),  # a material without the block of reflection is white
        (RED_VERTICES, {}, RED),
        (RED_VERTICES, material(pbrMetallicRoughness={"baseColorFactor": [0.1, 0.5, 0.5, 1]}), (0.1, DULL, DULL)),
        ({"COLOR_0": np.full((3, 4), (128, 0, 0, 255), "u1")}, material(**WHITE), (128 / 255, DULL, DULL)),
        ({"COLOR_0": np.full((3, 4), (32768, 0, 0, 65535), "<u2")}, material(**WHITE), (32768 / 65535, DULL, DULL)),
        ({}, material(pbrMetallicRoughness={"baseColorFactor": [0.25, 0.5, 0.75, 1]}), (0.25, 0.5, 0.75)),
        ({}, material(**WHITE), (0.9, 0.9, 0.9)),
    ],
)
def test_colours_of_gltf(tmp_path: Path, arrays: dict[str, np.ndarray], content: Any, color: tuple[float, ...]) -> None:
    chosen = {"material": 0} if content else {}
    (part,) = read(glb(tmp_path / "mesh.glb", arrays, content, **chosen)).parts
    np.testing.assert_allclose(part.material.color, color, atol=1e-5)


@pytest.mark.parametrize(
    ("content", "primitive", "reason"),
    [
        ({"extensionsRequired": ["KHR_materials_pbrSpecularGlossiness"]}, {}, "KHR_materials_pbrSpecularGlossiness"),
        ({"extensionsRequired": ["VENDOR_unheard_of"]}, {}, "VENDOR_unheard_of"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, {}, "KHR_draco_mesh_compression"),
        ({"extensionsRequired": ["EXT_meshopt_compression"]}, {}, "EXT_meshopt_compression"),
        (
            material(alphaMode="BLEND", pbrMetallicRoughness={"baseColorFactor": [1, 1, 1, 0]}),
            {"material": 0},
            "transparent|opa",
        ),
        ({"buffers": [{"byteLength": 36, "uri": "lost.bin"}]}, {}, "lost.bin"),
        ({"asset": {"version": "1.0"}}, {}, "version '1.0'"),
        ({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 99, "type": "VEC3"}]}, {}, "mesh.glb"),
        ({"nodes": [{"mesh": 0, "children": [0]}]}, {}, "mesh.glb"),
        ({"nodes": [{"mesh": 4}]}, {}, "meshes 4"),
        ({"nodes": [{"mesh": 0, "matrix": ROW_BY_ROW}]}, {}, "node 0 with a matrix whose last row is 0.5, 0, 0, 1"),
        ({"nodes": [{"mesh": 0, "rotation": [0, 0, 90, 1]}]}, {}, "node 0 with a rotation of length 90"),
        ({"buffers": [{"byteLength": 36, "uri": "pointer.bin"}]}, {}, "pointer.bin: found a pointer of Git LFS"),
        ({"nodes": [{"mesh": 0, "matrix": IDENTITY, "scale": [2, 2, 2]}]}, {}, "node 0 with a matrix and scale"),
    ],
)
def test_gltf_that_cannot_be_drawn_is_refused_in_one_line(
    tmp_path: Path, content: Any, primitive: Any, reason: str
) -> None:
    (tmp_path / "pointer.bin").write_text(POINTER)
    with pytest.raises(MeshError, match=reason) as raised:
        read(glb(tmp_path / "mesh.glb", {}, content, **primitive))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("arrays", "content", "note"),
    [
        ({}, {"extensionsUsed": ["KHR_materials_clearcoat"]}, "KHR_materials_clearcoat"),
        ({"_TEMPERATURE": np.zeros((3, 2), "<f4")}, {}, "_TEMPERATURE"),
        ({}, {"animations": [{"channels": [], "samplers": []}]}, "animation"),
        ({}, material(normalTexture={"index": 0}), "normalTexture"),
        ({}, material(emissiveFactor=[1, 1, 1]), "emissiveFactor"),
        ({}, material(pbrMetallicRoughness={"baseColorFactor": [255, 0, 0, 255]}), "0 to 1, cut to it: baseColor"),
        ({"COLOR_0": np.full((3, 3), 200.0, "<f4")}, {}, "beyond 0 to 1, cut to it: COLOR_0"),
        ({}, material(pbrMetallicRoughness={"baseColorTexture": {"index": 0}}) | {
            "textures": [{"source": 0}], "images": [{"uri": "lost.png"}]}, "lost.png"),
    ],
)  # fmt: skip
def test_what_of_gltf_is_not_used_is_named(tmp_path: Path, arrays: Any, content: Any, note: str) -> None:
    chosen = {"material": 0} if "materials" in content else {}
    mesh = read(glb(tmp_path / "mesh.glb", arrays, content, **chosen))
    assert any(note in each for each in mesh.notes)
    np.testing.assert_allclose(area(mesh), 0.5)


@pytest.mark.parametrize(("name", "width"), [("NORMAL", 3), ("TANGENT", 4), ("TEXCOORD_1", 2)])
def test_what_changes_nothing_is_not_named(tmp_path: Path, name: str, width: int) -> None:
    """Facets have normals of their own, and texture coordinates count with a picture."""
    assert read(glb(tmp_path / "mesh.glb", {name: np.ones((3, width), "<f4")})).notes == ()


def test_nodes_of_gltf_scale_and_repeat_a_mesh_as_another_reader_has_it(tmp_path: Path) -> None:
    turned = [0.0, 0.0, np.sin(0.4), np.cos(0.4)]
    nodes = [{"children": [1, 2], "scale": [2, 2, 2]}, {"mesh": 0, "rotation": turned},
             {"mesh": 0, "matrix": [3, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]}]  # fmt: skip
    path = glb(tmp_path / "mesh.glb", {}, {"nodes": nodes})
    other = trimesh.load(path, force="mesh")
    mesh = read(path)
    np.testing.assert_allclose(area(mesh), other.area, rtol=1e-6)
    np.testing.assert_allclose(np.ptp(mesh.bounds, axis=0), np.ptp(other.bounds, axis=0), rtol=1e-6, atol=1e-9)


L_SHAPE = [(1, -1), (1, 0), (0, 0), (0, 1), (-1, 1), (-1, -1)]
"""Corners of an L of area 3."""


def obj(path: Path, corners: list[tuple[float, float]], face: str, *head: str) -> Path:
    path.write_text("\n".join([*head, *(f"v {x} {y} 0" for x, y in corners), face]) + "\n")
    return path


@pytest.mark.parametrize("first", range(6))
@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_a_concave_face_keeps_its_area(tmp_path: Path, first: int, way: int, suffix: str) -> None:
    order = [(first + way * step) % 6 for step in range(6)]
    path = tmp_path / f"l{suffix}"
    if suffix == ".obj":
        obj(path, L_SHAPE, "f " + " ".join(str(index + 1) for index in order))
    else:
        head = ["ply", "format ascii 1.0", "element vertex 6", *(f"property float {axis}" for axis in "xyz")]
        head += ["element face 1", "property list uchar int vertex_indices", "end_header"]
        rows = [f"{x} {y} 0" for x, y in L_SHAPE] + ["6 " + " ".join(map(str, order))]
        path.write_text("\n".join([*head, *rows]) + "\n")
    np.testing.assert_allclose(area(read(path)), 3.0, rtol=1e-6)


def test_a_face_that_crosses_itself_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="cross") as raised:
        read(obj(tmp_path / "tie.obj", [(0, 0), (1, 1), (1, 0), (0, 1)], "f 1 2 3 4"))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("face", ["f 1 2 3 4", "f -4 -3 -2 -1", "f 1/1 2/1 3/1 4/1", "f 1//1 2//1 3//1 4//1"])
def test_forms_of_faces(tmp_path: Path, face: str) -> None:
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    mesh = read(obj(tmp_path / "square.obj", square, face, "vt 0 0", "vn 0 0 1"))
    np.testing.assert_allclose(area(mesh), 1.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("picture", "is_found"),
    [
        ("my texture.png", True),
        (".\\my texture.png", True),
        ("-s 1 1 1 my texture.png", True),
        ("-bm 0.5 -clamp on my texture.png", True),
        ("C:\\Users\\me\\my texture.png", True),
        ("/home/me/my texture.png", True),
        ("lost.png", False),
    ],
)
def test_pictures_of_obj(tmp_path: Path, picture: str, is_found: bool) -> None:
    cv2.imwrite(str(tmp_path / "my texture.png"), np.full((4, 4, 3), (0, 0, 255), np.uint8))  # red
    (tmp_path / "m.mtl").write_text(f"newmtl paint\nKd 1 1 1\nmap_Kd {picture}\n")
    path = tmp_path / "mesh.obj"
    places = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
    path.write_text(f"mtllib m.mtl\n{places}usemtl paint\nf 1/1 2/2 3/3\n")
    mesh = read(path)
    (part,) = mesh.parts
    assert (part.material.texture is not None) == is_found
    if part.material.texture is not None:
        assert part.material.texture[0, 0].argmax() == 0
    assert is_found or any("lost.png" in note for note in mesh.notes)


@pytest.mark.parametrize(
    ("head", "note"),
    [
        ("mtllib lost.mtl\nusemtl paint", "not found beside the mesh: 'lost.mtl'"),
        ("mtllib pointer.mtl\nusemtl paint", "'pointer.mtl' is a pointer of Git LFS"),
        ("usemtl paint", "paint"),
        ("curv 0 1 1 2", "curv"),
    ],
)
def test_what_of_obj_is_not_used_is_named(tmp_path: Path, head: str, note: str) -> None:
    (tmp_path / "pointer.mtl").write_text(POINTER)
    corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]
    mesh = read(obj(tmp_path / "mesh.obj", corners, "f 1 2 3", head))
    assert any(note in each for each in mesh.notes)
    (part,) = mesh.parts
    np.testing.assert_allclose(part.material.color, 0.5)  # grey, as without a library


@pytest.mark.parametrize(
    ("library", "name"),
    [
        ("newmtl Material #25\nKd 0 0 1\nnewmtl Material #26\nKd 1 0 0  # red\n", "Material #26"),
        ("newmtl paint # of the panel\nKd 1 0 0\n", "paint    # red"),
        ("# newmtl\n#newmtl x\nnewmtl paint\n# Kd 0 0 1\n#Kd 0 0 1\nKd 1 0 0\n", "paint"),
    ],
)
def test_a_hash_is_part_of_a_name_unless_a_space_follows(tmp_path: Path, library: str, name: str) -> None:
    (tmp_path / "m.mtl").write_text(library)
    corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]
    mesh = read(obj(tmp_path / "mesh.obj", corners, "f 1 2 3", "mtllib m.mtl", f"usemtl {name}"))
    (part,) = mesh.parts
    np.testing.assert_allclose(part.material.color, RED, atol=1e-3)
    assert mesh.notes == ()


@pytest.mark.parametrize("color", ["200 30 30", "-0.5 0.5 0.5", "1.5"])
def test_colours_of_8_bit_in_a_library_are_named(tmp_path: Path, color: str) -> None:
    (tmp_path / "m.mtl").write_text(f"newmtl paint\nKd {color}\n")
    corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]
    mesh = read(obj(tmp_path / "mesh.obj", corners, "f 1 2 3", "mtllib m.mtl", "usemtl paint"))
    assert mesh.notes == (f"colours and factors of materials beyond 0 to 1, cut to it: Kd {color}",)


@pytest.mark.parametrize(("side", "units", "is_noted"), [(100.0, None, True), (100.0, "m", False), (30.0, None, False)])
def test_a_mesh_that_may_be_in_millimetres_is_named(tmp_path: Path, side: float, units: str, is_noted: bool) -> None:
    path = obj(tmp_path / "mesh.obj", [(0.0, 0.0), (side, 0.0), (0.0, side)], "f 1 2 3")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mesh = load_mesh(path, units, center=True)
    assert any(f"a span of {side:g} m" in note for note in mesh.notes) == is_noted


def test_normals_where_colours_stand_are_named(tmp_path: Path) -> None:
    path = tmp_path / "mesh.obj"
    path.write_text("v 0 0 0 0 0 -1\nv 1 0 0 0 0 -1\nv 0 1 0 0 0 -1\nf 1 2 3\n")
    assert read(path).notes == ("colours and factors of materials beyond 0 to 1, cut to it: v",)


@pytest.mark.parametrize("values", [np.full((4, 4), 0.5, np.float32), np.full((4, 4), 200, np.int32)])
def test_a_picture_without_codes_is_named_and_not_black(tmp_path: Path, values: np.ndarray) -> None:
    Image.fromarray(values).save(tmp_path / "t.tif")
    (tmp_path / "m.mtl").write_text("newmtl paint\nmap_Kd t.tif\n")
    path = tmp_path / "mesh.obj"
    path.write_text("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl paint\nf 1/1 2/2 3/3\n")
    mesh = read(path)
    assert mesh.parts[0].material.texture is None
    assert "pictures that cannot be read" in mesh.notes[0] and "t.tif" in mesh.notes[0]


@pytest.mark.parametrize(("kind", "value", "is_noted"), [("uchar", 1, True), ("uchar", 2, False), ("float", 1, False)])
def test_whole_numbers_of_0_and_1_are_named_as_colours(tmp_path: Path, kind: str, value: int, is_noted: bool) -> None:
    head = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {axis}" for axis in "xyz")]
    head += [f"property {kind} {name}" for name in ("red", "green", "blue")]
    head += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    rows = [f"{x} {y} 0 {value} 0 0" for x, y in ((0, 0), (1, 0), (0, 1))]
    path = tmp_path / "mesh.ply"
    path.write_text("\n".join([*head, *rows, "3 0 1 2"]) + "\n")
    assert any("almost black" in note for note in read(path).notes) == is_noted


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"ISO-10303-21;\nHEADER;\nFILE_NAME('a');\n" * 9, "b'ISO-10303-21;"),
        (b"PK\x03\x04" + bytes(200), "b'PK"),
        (b"ply\nformat ascii 1.0\n", "b'ply"),
        (bytes(80) + struct.pack("<I", 12) + bytes(500), "584 bytes"),
    ],
)
def test_what_is_no_stl_is_named_for_its_beginning(tmp_path: Path, content: bytes, found: str) -> None:
    path = tmp_path / "mesh.stl"
    path.write_bytes(content)
    with pytest.raises(MeshError) as raised:
        read(path)
    assert f"found {found}" in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_colours_of_the_faces_of_ply(tmp_path: Path, form: str) -> None:
    corners = trimesh.creation.box().vertices.astype(float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    colors = [(255, 0, 0)] * 3 + [(0, 255, 0)] * 3
    head = ["ply", f"format {form} 1.0", "element vertex 8", *(f"property float {axis}" for axis in "xyz")]
    head += ["property float confidence", "element face 6", "property list uchar int vertex_indices"]
    head += [*(f"property uchar {name}" for name in ("red", "green", "blue")), "end_header"]
    body = b""
    order = ">" if "big" in form else "<"
    for corner in corners:
        row = (*corner, 1.0)
        body += (" ".join(map(str, row)) + "\n").encode() if form == "ascii" else struct.pack(f"{order}4f", *row)
    for quad, color in zip(quads, colors, strict=True):
        row = (4, *quad, *color)
        body += (" ".join(map(str, row)) + "\n").encode() if form == "ascii" else struct.pack(f"{order}B4i3B", *row)
    path = tmp_path / "box.ply"
    path.write_bytes(("\n".join(head) + "\n").encode() + body)
    mesh = read(path)
    assert sorted(len(part.faces) for part in mesh.parts) == [6, 6]
    np.testing.assert_allclose(area(mesh), 6.0, rtol=1e-6)
    found = {tuple(np.round(part.material.color, 2)) for part in mesh.parts}
    assert found == {(0.9, 0.0, 0.0), (0.0, 0.9, 0.0)}
    assert any("confidence" in note for note in mesh.notes)


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply", ".stl"])
def test_geometry_is_that_of_another_reader(tmp_path: Path, suffix: str) -> None:
    shape = trimesh.creation.icosphere(subdivisions=1)
    path = tmp_path / f"ball{suffix}"
    shape.export(path)
    mesh = read(path)
    np.testing.assert_allclose(area(mesh), shape.area, rtol=1e-5)
    assert mesh.face_count == len(shape.faces)


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply", ".stl"])
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused_in_one_line(
    suffix: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("damaged") / f"box{suffix}"
    trimesh.creation.box().export(path)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        read(path)
    except RpojaxError as error:
        assert "\n" not in str(error)
