"""Hostile weights, pictures, data sets and meshes."""

import io
import json
import struct
from pathlib import Path

import numpy as np
from case_ledger import Case
from hostile_values import NUMBERS, SPECIAL_FILES, damaged_bytes, json_values, nested, special_path
from hypothesis import strategies as st
from PIL import Image

from rpojax.training.synthetic_data.detection_dataset import read_dataset, summary
from rpojax.training.synthetic_data.meshes.mesh_files import load_mesh
from rpojax.vision.imaging.image_files import read_image
from rpojax.vision.weight_files import read_model_card, read_tensors, write_tensors

DTYPES = ("F32", "F64", "F16", "BF16", "F8_E4M3", "F8_E5M2", "I64", "U8", "BOOL", "C64", "F4", "X9", "", "E8M0")
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n"
)
STL = (
    "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    "facet normal 0 1 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\nendfacet\nendsolid a\n"
)


def weight_cases(folder: Path) -> st.SearchStrategy[Case]:
    """Weight files in safetensors."""
    path = folder / "weights.safetensors"
    write_tensors(path, {"a": np.zeros((2, 3), np.float32), "b": np.ones(4, np.float16)}, {"card": '{"x": 1}'})
    base = path.read_bytes()

    def act(content: bytes) -> None:
        path.write_bytes(content)
        _, metadata = read_tensors(path)
        read_model_card(path, metadata)

    @st.composite
    def build(draw: st.DrawFn) -> Case:
        kinds = ("bytes", "bytes", "type", "shape", "offsets", "header size", "depth", "card", "none")
        damage = draw(st.sampled_from(kinds))
        place = draw(st.sampled_from(("a", "b")))
        size = struct.unpack("<Q", base[:8])[0]
        header = json.loads(base[8 : 8 + size])
        content = base
        match damage:
            case "bytes":
                damage, content = damaged_bytes(base, draw)
            case "none":
                content = _with_header(json.dumps(header, indent=1).encode(), base[8 + size :])
            case "header size":
                count = draw(st.sampled_from((0, 7, size + 1, 2**31, 2**63, 2**64 - 1)))
                content = struct.pack("<Q", count) + base[8:]
            case "depth":
                content = _with_header(nested(draw(st.sampled_from((70, 3000, 100_000)))).encode(), base[8 + size :])
            case "card":
                card = draw(st.one_of(json_values(), st.sampled_from((70, 100_000)).map(nested)))
                header["__metadata__"]["card"] = card
                content = _with_header(json.dumps(header).encode(), base[8 + size :])
            case _:
                key = {"type": "dtype", "shape": "shape", "offsets": "data_offsets"}[damage]
                values = {
                    "type": st.sampled_from(DTYPES),
                    "shape": st.lists(st.sampled_from((0, 1, 2, 3, -1, 2**31, 2**62)), max_size=5),
                    "offsets": st.lists(st.sampled_from((0, 8, 24, 2**40, -8)), max_size=3),
                }
                header[place][key] = draw(values[damage])
                content = _with_header(json.dumps(header).encode(), base[8 + size :])
        return Case("weights", damage, place, lambda: act(content))

    return st.one_of(build(), _special("weights", folder, ".safetensors", read_tensors))


def picture_cases(folder: Path) -> st.SearchStrategy[Case]:
    """Pictures for the detector."""
    bases = {}
    for form, mode in (("PNG", "RGB"), ("PNG", "RGBA"), ("PNG", "I;16"), ("JPEG", "RGB"), ("PNG", "P")):
        stream = io.BytesIO()
        Image.new(mode, (12, 9)).save(stream, form)
        bases[f"{form} {mode}"] = stream.getvalue()

    def act(content: bytes) -> None:
        path = folder / "picture.png"
        path.write_bytes(content)
        assert read_image(path).shape[2] == 3

    @st.composite
    def build(draw: st.DrawFn) -> Case:
        name = draw(st.sampled_from(sorted(bases)))
        damage, content = damaged_bytes(bases[name], draw)
        if name.startswith("PNG") and draw(st.integers(0, 3)) == 0:
            sides = st.sampled_from((0, 1, 60_000, 2**31 - 1, 10_000))
            damage, content = "size", content_of_png(bases[name], draw(sides), draw(sides))
        return Case("picture", damage, name, lambda: act(content))

    return st.one_of(build(), _special("picture", folder, ".png", read_image))


def content_of_png(content: bytes, width: int, height: int) -> bytes:
    """A PNG that says that it has other sides."""
    import zlib

    chunk = b"IHDR" + struct.pack(">II", width, height) + content[24:29]
    return content[:12] + chunk + struct.pack(">I", zlib.crc32(chunk)) + content[33:]


def data_set_cases(folder: Path) -> st.SearchStrategy[Case]:
    """Data sets in COCO format."""
    place = folder / "dataset"
    (place / "images").mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (20, 10)).save(place / "images" / "a.png")
    Image.new("RGB", (20, 10)).save(folder / "outside.png")
    base = {
        "info": {"made": "x"},
        "categories": [{"id": 1, "name": "spacecraft"}],
        "images": [{"id": 1, "file_name": "images/a.png", "width": 20, "height": 10}],
        "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4], "iscrowd": 0}],
    }
    outside = ("../outside.png", str(folder / "outside.png"), "/dev/zero", "images/../../outside.png", "a\0b", "")

    def act(text: str, refused: bool = False) -> None:
        (place / "annotations.json").write_text(text, errors="surrogatepass")
        summary(place)
        read_dataset(place)
        assert not refused, "accepted what reads outside of the data set"

    @st.composite
    def build(draw: st.DrawFn) -> Case:
        from hostile_folders import json_fields, with_field

        damage = draw(st.sampled_from(("entry", "removed", "box", "file name", "bytes", "depth")))
        field = draw(st.sampled_from(list(json_fields(base))))
        text = json.dumps(base)
        match damage:
            case "entry" | "removed":
                text = with_field(base, field, None if damage == "removed" else draw(json_values()))
            case "box":
                numbers = st.sampled_from(
                    ("1e308", "-1e308", "0", "NaN", "Infinity", "1e999", "5", "-3", '"1"', "null")
                )
                box = [draw(numbers) for _ in range(draw(st.sampled_from((4, 4, 4, 3, 5, 0))))]
                field = ("annotations", 0, "bbox")
                text = with_field(base, field, f"[{', '.join(box)}]")
            case "file name":
                field = ("images", 0, "file_name")
                text = with_field(base, field, json.dumps(draw(st.sampled_from(outside))))
            case "bytes":
                text = damaged_bytes(text.encode(), draw)[1].decode("utf-8", "replace")
            case _:
                text = nested(draw(st.sampled_from((70, 3000, 100_000))))
        name = ".".join(str(part) for part in field if isinstance(part, str))
        return Case("data set", damage, name, lambda: act(text, damage == "file name"))

    return build()


def mesh_cases(folder: Path) -> st.SearchStrategy[Case]:
    """Meshes: no vertex may vanish, so an accepted mesh has all the triangles of its file or fewer by zero area."""
    bases = {".obj": OBJ, ".ply": PLY, ".stl": STL}

    def act(suffix: str, content: bytes, finite: bool) -> None:
        path = folder / f"mesh{suffix}"
        path.write_bytes(content)
        load_mesh(path, center=True)
        assert finite, "accepted a vertex that is not finite"

    @st.composite
    def build(draw: st.DrawFn) -> Case:
        suffix = draw(st.sampled_from(sorted(bases)))
        damage = draw(st.sampled_from(("bytes", "number", "not finite", "reference")))
        content, finite = bases[suffix].encode(), True
        match damage:
            case "bytes":
                damage, content = damaged_bytes(content, draw)
            case "number":
                words = bases[suffix].split(" ")
                words[draw(st.integers(0, len(words) - 1))] = draw(st.sampled_from(NUMBERS))
                content = " ".join(words).encode()
            case "not finite":
                number = draw(st.sampled_from(("nan", "inf", "-inf")))
                mark = {".obj": "v 1 0 0", ".ply": "\n1 0 0", ".stl": "vertex 1 0 0"}[suffix]
                content = content.replace(mark.encode(), mark.replace("1", number).encode())
                finite = False
            case _:
                name = draw(st.sampled_from(("../../etc/passwd", "/dev/zero", "x.mtl", "mesh.obj")))
                content = f"mtllib {name}\n".encode() + content if suffix == ".obj" else content
        return Case("mesh", damage, suffix, lambda: act(suffix, content, finite))

    return st.one_of(build(), _special("mesh", folder, ".obj", load_mesh))


def _with_header(header: bytes, data: bytes) -> bytes:
    return struct.pack("<Q", len(header)) + header + data


@st.composite
def _special(draw: st.DrawFn, kind: str, folder: Path, suffix: str, read: object) -> Case:
    damage = draw(st.sampled_from(SPECIAL_FILES))

    def act() -> None:
        assert callable(read)
        read(special_path(folder, damage, suffix))

    return Case(kind, f"path: {damage}", suffix, act)
