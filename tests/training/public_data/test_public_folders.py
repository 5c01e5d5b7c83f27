"""Folders as SPEED+, SPARK and YOLO have them are read with their boxes, and faults are told in one line."""

import json
import warnings
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rpojax.cli import main
from rpojax.errors import Notice
from rpojax.training.labelled_pictures.dataset_faults import DatasetError
from rpojax.training.public_data import data_formats, speed_folder
from rpojax.training.public_data.data_formats import PublicFormat
from rpojax.training.public_data.labelled_picture import LabelledPicture, evenly_chosen

WIDTH, HEIGHT = 480, 300
MATRIX = [[750.0, 0.0, 240.0], [0.0, 750.0, 150.0], [0.0, 0.0, 1.0]]
TRANSPOSED = [[750.0, 0.0, 0.0], [0.0, 750.0, 0.0], [240.0, 150.0, 1.0]]
MIRRORED = [[-750.0, 0.0, 240.0], [0.0, -750.0, 150.0], [0.0, 0.0, 1.0]]
DISTORTION = [-0.22, 0.51, -0.0006, -0.0002, -0.13]
SPARK_OF = 'Class,Image name,Bounding box\nSoho,0.png,"({})"\n'
CAMERA = {"Nu": WIDTH, "Nv": HEIGHT, "cameraMatrix": MATRIX, "distCoeffs": DISTORTION}

POSE = {"filename": "img000000.png", "q_vbs2tango_true": [1, 0, 0, 0], "r_Vo2To_vbs_true": [0, 0, 5]}


def draw(path: Path, box: tuple[float, float, float, float] | None) -> None:
    """A dark picture with a grey rectangle."""
    picture = np.full((HEIGHT, WIDTH, 3), 4, np.uint8)
    if box is not None:
        left, top, right, bottom = (round(edge) for edge in box)
        picture[max(0, top) : bottom, max(0, left) : right] = 150
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), picture)


def poses() -> list[tuple[np.ndarray, np.ndarray]]:
    """Attitudes (scalar first, of the camera in the spacecraft's axes as SPEED+ has them) and positions."""
    rng = np.random.default_rng(4)
    turns = Rotation.from_quat(rng.standard_normal((3, 4)))
    return [
        (turn.as_quat()[[3, 0, 1, 2]], np.array([rng.uniform(-0.4, 0.4), rng.uniform(-0.3, 0.3), rng.uniform(5, 8)]))
        for turn in turns
    ]


def independent_box(q: np.ndarray, r: np.ndarray) -> tuple[float, float, float, float]:
    """Box of Tango's points by SciPy's rotation and the Brown model, written out."""
    points = Rotation.from_quat(q[[1, 2, 3, 0]]).apply(speed_folder.TANGO_POINTS) + r
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    k1, k2, p1, p2, k3 = DISTORTION
    square = x * x + y * y
    radial = 1.0 + k1 * square + k2 * square**2 + k3 * square**3
    u = 750.0 * (x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x)) + 240.0
    v = 750.0 * (y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y) + 150.0
    return float(u.min()), float(v.min()), float(u.max()), float(v.max())


def speed_plus(root: Path) -> Path:
    """A domain of a data set like SPEED+: `camera.json` above, `lightbox/test.json` and `lightbox/images`."""
    domain = root / "lightbox"
    entries = []
    for number, (q, r) in enumerate(poses()):
        name = f"img{number:06d}.png"
        draw(domain / "images" / name, independent_box(q, r))
        entries.append({"filename": name, "q_vbs2tango_true": list(q), "r_Vo2To_vbs_true": list(r)})
    (domain / "test.json").write_text(json.dumps(entries))
    (root / "camera.json").write_text(json.dumps(CAMERA))
    return domain


def shirt(root: Path) -> Path:
    """A domain of a data set like SHIRT: `camera.json` two folders above, `roe1.json` and other metadata one above."""
    domain = speed_plus(root / "roe1")
    (root / "roe1" / "camera.json").rename(root / "camera.json")
    (domain / "test.json").rename(root / "roe1" / "roe1.json")
    (root / "roe1" / "metadata.json").write_text('{"dt": 5.0}')
    return domain


def write_spark(table: Path, head: str, names: tuple[str, str], row: str, place: Callable[[int, str], Path]) -> None:
    """A table of two pictures, its rows from number and name of the spacecraft, and the pictures in their places."""
    lines = [head]
    for number, craft in enumerate(names):
        draw(place(number, craft), (40 + number, 60, 200, 140))
        lines.append(row.format(number=number, craft=craft, left=40 + number))
    table.write_text("\n".join(lines) + "\n")


def spark(root: Path) -> Path:
    """A data set like SPARK of 2024: `val.csv`, and pictures in `images` in a folder of each class and part."""
    write_spark(
        root / "val.csv",
        "Class,Image name,Mask name,Bounding box",
        ("Soho", "XMM Newton"),
        '{craft},{number}.png,m.png,"({left}, 60, 200, 140)"',
        lambda number, craft: root / "images" / craft / "val" / f"{number}.png",
    )
    return root


def spark_2022(root: Path) -> Path:
    """A data set like SPARK of 2022: rows before columns, all pictures together, and JPEG files named as PNG files."""
    write_spark(
        root / "val.csv",
        "filename,class,bbox",
        ("soho", "xmm_newton"),
        '{number}.png,{craft},"[60, {left}, 140, 200]"',
        lambda number, craft: root / "val" / f"{number}.jpg",
    )
    return root


def spark_2021(root: Path) -> Path:
    """A data set like SPARK of 2021: as in 2022, with a folder of each class."""
    write_spark(
        root / "validation labels.csv",
        "image,depth,class,bbox",
        ("Jason", "Sentinel-6"),
        '{number}.png,d.png,{craft},"[60, {left}, 140, 200]"',
        lambda number, craft: root / "validation" / craft / f"{number}.png",
    )
    return root


def yolo(root: Path) -> Path:
    """A data set in YOLO's layout with two pictures, one of them empty."""
    draw(root / "images" / "val" / "a.png", (120.0, 75.0, 240.0, 150.0))
    draw(root / "images" / "val" / "b.png", None)
    (root / "labels" / "val").mkdir(parents=True)
    (root / "labels" / "val" / "a.txt").write_text("0 0.375 0.375 0.25 0.25\n")
    return root


def test_a_pose_of_speed_is_projected_as_its_authors_do() -> None:
    # A quarter turn about the boresight: q_vbs2tango takes the axes of the camera to those of Tango, so that Tango's x
    # axis is the camera's y axis, which points down.
    half = float(np.sqrt(0.5))
    box = speed_folder.projected_box(
        np.array(MATRIX), np.zeros(5), np.array([half, 0, 0, half]), np.array([0.0, 0.0, 1e4])
    )
    # Far away perspective vanishes: the camera's x is minus Tango's y.
    points = speed_folder.TANGO_POINTS
    expected = (
        750.0 / 1e4 * np.array([-points[:, 1].max(), points[:, 0].min(), -points[:, 1].min(), points[:, 0].max()])
    )
    np.testing.assert_allclose(box, expected + np.array([240.0, 150.0, 240.0, 150.0]), atol=1e-5)


@pytest.mark.parametrize("make", [speed_plus, shirt])
def test_boxes_of_poses_agree_with_an_independent_projection(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    data = data_formats.read_folder(make(tmp_path), "speed")
    scale = data.images.shape[1] / WIDTH
    for found, (q, r) in zip(data.boxes, poses(), strict=True):
        expected = np.clip(independent_box(q, r), 0.0, [WIDTH, HEIGHT] * 2) * scale
        np.testing.assert_allclose(found[0], expected, atol=1e-4)
    assert data.backgrounds == ("lightbox",) * 3


def test_the_folder_where_one_is_will_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(shirt(tmp_path))
    assert data_formats.read_folder(Path(), "speed").backgrounds == ("lightbox",) * 3


def test_speed_has_a_folder_for_each_of_its_lists(tmp_path: Path) -> None:
    domain = speed_plus(tmp_path)
    (domain / "images").rename(domain / "train")
    (domain / "images").mkdir()
    (domain / "train").rename(domain / "images" / "train")
    entries = json.loads((domain / "test.json").read_text())
    old = [{"q_vbs2tango" if "true" in key and "q" in key else key: entry[key] for key in entry} for entry in entries]
    (domain / "train.json").write_text(json.dumps(old))
    (domain / "test.json").write_text('[{"filename": "img000000.png"}]')
    with pytest.raises(DatasetError, match="other labels"):
        data_formats.read_folder(domain, "speed")
    assert len(data_formats.read_folder(domain, "speed", domain / "train.json")) == 3


@pytest.mark.parametrize(
    ("make", "names"),
    [
        (spark, ("Soho", "XMM Newton")),
        (spark_2022, ("soho", "xmm_newton")),
        (spark_2021, ("Jason", "Sentinel-6")),
    ],
)
def test_tables_of_spark_are_read(tmp_path: Path, make: Callable[[Path], Path], names: tuple[str, str]) -> None:
    data = data_formats.read_folder(make(tmp_path), "spark")
    scale = data.images.shape[1] / WIDTH
    np.testing.assert_allclose(
        [each[0] for each in data.boxes], np.array([[40, 60, 200, 140], [41, 60, 200, 140]]) * scale
    )
    assert data.backgrounds == names


def test_yolo_has_fractions_and_empty_pictures(tmp_path: Path) -> None:
    data = data_formats.read_folder(yolo(tmp_path), "yolo")
    scale = data.images.shape[1] / WIDTH
    np.testing.assert_allclose(data.boxes[0], np.array([[120, 75, 240, 150]]) * scale, rtol=1e-6)
    assert [len(each) for each in data.boxes] == [1, 0]


def test_a_limit_takes_pictures_evenly() -> None:
    entries = [LabelledPicture(Path(str(number)), np.zeros((0, 4))) for number in range(101)]
    assert [each.path.name for each in evenly_chosen(entries, 3)] == ["0", "50", "100"]
    assert evenly_chosen(entries, None) == entries


@pytest.mark.parametrize(
    ("form", "make", "name", "content", "said"),
    [
        ("speed", speed_plus, "camera.json", "{}", "cameraMatrix"),
        ("speed", speed_plus, "lightbox/test.json", '[{"filename": "img000000.png"}]', "q_vbs2tango_true"),
        ("speed", speed_plus, "lightbox/test.json", "{}", "list"),
        (
            "speed",
            speed_plus,
            "lightbox/test.json",
            '[{"filename": "../../x.png", "q_vbs2tango_true": [1, 0, 0, 0], "r_Vo2To_vbs_true": [0, 0, 5]}]',
            "without folders",
        ),
        (
            "speed",
            speed_plus,
            "lightbox/test.json",
            '[{"filename": "img000000.png", "q_vbs2tango_true": [1, 0, 0, 0], "r_Vo2To_vbs_true": [0, 0, -5]}]',
            "in front",
        ),
        ("spark", spark, "val.csv", "a,b\n1,2\n", "Bounding box"),
        ("spark", spark, "val.csv", 'Class,Image name,Bounding box\nSoho,0.png,"(1, 2)"\n', "line 2"),
        ("spark", spark, "val.csv", 'Class,Image name,Bounding box\nSoho,0.png,"(500, 60, 600, 90)"\n', "within"),
        ("spark", spark, "val.csv", 'Class,Image name,Bounding box\nSoho,9.png,"(1, 2, 3, 4)"\n', "no such file"),
        ("spark", spark, "val.csv", "Class,Image name,Bounding box\n", "no rows"),
        ("spark", spark, "val.csv", 'Class,Image name,Bounding box\n..,0.png,"(1, 2, 3, 4)"\n', "without folders"),
        ("spark", spark, "val.csv", f'Class,Image name,Bounding box\nSoho,0.png,"(1, 2, 3, 1{"0" * 400})"\n', "line 2"),
        ("spark", spark, "val.csv", 'Class,Image name,Bounding box\nSoho,0.png,"(1, 2, inf, 4)"\n', "line 2"),
        ("spark", spark, "val.csv", f'Class,Image name,Bounding box\nSoho,{"a" * 9000},"(1, 2, 3, 4)"\n', "no such"),
        ("spark", spark, "val.csv", f"Class,Image name,Bounding box\nSoho,0.png,{'1' * 200_000}\n", "cannot be read"),
        ("spark", spark_2022, "val.csv", "filename,class,bbox\n0.png,soho,\n", "(top, left, bottom, right)"),
        ("speed", speed_plus, "camera.json", json.dumps(CAMERA | {"Nu": 1920, "Nv": 1200}), "1920 x 1200"),
        ("speed", shirt, "roe1/roe1.json", "[]", "an empty list"),
        ("speed", speed_plus, "camera.json", json.dumps(CAMERA | {"cameraMatrix": TRANSPOSED}), "cameraMatrix [[750.0"),
        ("speed", speed_plus, "camera.json", json.dumps(CAMERA | {"cameraMatrix": MIRRORED}), "cameraMatrix [[-750.0"),
        ("spark", spark, "val.csv", 'Class,Image name,Bounding box\nSoho,0.png,"(1_0, 2, 30, 4)"\n', "line 2"),
        ("spark", spark, "val.csv", "filename,class,bbox,Class,Image name,Bounding box\n", "of one edition"),
        (
            "speed",
            speed_plus,
            "camera.json",
            json.dumps({"dist_coeffs" if key == "distCoeffs" else key: value for key, value in CAMERA.items()}),
            "'distCoeffs'",
        ),
        (
            "speed",
            speed_plus,
            "lightbox/test.json",
            json.dumps([{**POSE, "q_vbs2tango": [0, 0, 0, 1]}]),
            "with different q_vbs2tango_true and q_vbs2tango",
        ),
        ("spark", spark, "val.csv", 'Class,Image name,Bounding box,Class\nSoho,0.png,"(1, 2, 3, 4)",a\n', "each once"),
        ("yolo", yolo, "labels/val/a.txt", "0 0.5 0.5 0_1 0.1\n", "'0 0.5 0.5 0_1 0.1'"),
        ("yolo", yolo, "images/val/a.jpg", "", "two pictures of this name"),
        ("yolo", yolo, "labels/val/a.txt", "0 0.1 0.2\n", "class"),
        ("yolo", yolo, "labels/val/a.txt", "0 .1 .1 .2 .1 .2 .2 .1 .2\n", "a line of 9 words, as of outlines"),
        ("yolo", yolo, "labels/val/a.txt", "0 .3 .3 .2 .2 .97\n", "a line of 6 words, as of detections"),
        ("yolo", yolo, "labels/val/img_b.txt", "0 .3 .3 .2 .2\n", "1 pictures without such a file, as b.txt"),
        (
            "yolo",
            yolo,
            "labels/b.txt",
            "0 .3 .3 .2 .2\n",
            "1 pictures without such a file, as b.txt, would count as empty",
        ),
        ("yolo", yolo, "images/val/b.txt", "0 .3 .3 .2 .2\n", "1 pictures without such a file, as b.txt, would count"),
        ("yolo", yolo, "labels/val/a.txt", "-1 .3 .3 .2 .2\n", "classes [-1]"),
        ("yolo", yolo, "labels/val/a.txt", "0 nan 0.2 0.1 0.1\n", "fractions"),
        ("yolo", yolo, "labels/val/a.txt", "0 0.5 0.5 0.1 0.1\n1 0.5 0.5 0.1 0.1\n", "classes"),
    ],
)
def test_faults_are_told_in_one_line(
    tmp_path: Path, form: PublicFormat, make: Callable[[Path], Path], name: str, content: str, said: str
) -> None:
    folder = make(tmp_path)
    (tmp_path / name).write_text(content)
    with pytest.raises(DatasetError) as error:
        data_formats.read_folder(folder, form)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def far_away(entries: str) -> str:
    """Labels of SPEED+ whose positions are in millimetres."""
    listed = json.loads(entries)
    for entry in listed:
        entry["r_Vo2To_vbs_true"] = [1e3 * value for value in entry["r_Vo2To_vbs_true"]]
    return json.dumps(listed)


@pytest.mark.parametrize(
    ("form", "make", "name", "changed", "cause"),
    [
        ("speed", speed_plus, "lightbox/test.json", far_away, "all 3 boxes are below 2 px: is the position in metres"),
        ("spark", spark, "val.csv", lambda _: SPARK_OF.format("0.1, 0.2, 0.4, 0.5"), "are they fractions"),
        ("spark", spark, "val.csv", lambda _: SPARK_OF.format("400, 200, 800, 500"), "scaled after labelling"),
        ("yolo", yolo, "labels/val/a.txt", lambda _: "0 0.55 0.3 0.95 0.4", "are they corners"),
        (
            "yolo",
            yolo,
            "labels/val/a.txt",
            lambda _: "3 0.375 0.375 0.25 0.25\n",
            "boxes of class 3 count as spacecraft",
        ),
        ("yolo", yolo, "labels/val/a.txt", lambda _: "0 0.5 0.5 0.2 0.2\n" * 2, "stand once more"),
    ],
)
def test_implausible_labels_of_each_format_are_noticed(
    tmp_path: Path,
    form: PublicFormat,
    make: Callable[[Path], Path],
    name: str,
    changed: Callable[[str], str],
    cause: str,
) -> None:
    folder = make(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert data_formats.read_folder(folder, form).notes == ()
    (tmp_path / name).write_text(changed((tmp_path / name).read_text()))
    with pytest.warns(Notice, match=cause):
        assert cause in data_formats.read_folder(folder, form).notes[0]


@pytest.mark.parametrize(
    ("form", "make", "name"), [("spark", spark, "val.csv"), ("speed", speed_plus, "lightbox/test.json")]
)
def test_a_picture_that_is_listed_twice_is_refused(
    tmp_path: Path, form: PublicFormat, make: Callable[[Path], Path], name: str
) -> None:
    folder, text = make(tmp_path), (tmp_path / name).read_text()
    if form == "spark":
        (tmp_path / name).write_text(text + text.splitlines()[-1])
    else:
        (tmp_path / name).write_text(json.dumps(json.loads(text) + json.loads(text)[:1]))
    with pytest.raises(DatasetError, match=r"found 2 entries of .* with this picture"):
        data_formats.read_folder(folder, form)


def test_other_texts_beside_labels_are_no_boxes(tmp_path: Path) -> None:
    folder = yolo(tmp_path)
    (folder / "labels" / "val" / "classes.txt").write_text("spacecraft\n")
    for hidden in ("labels/val/._a.txt", "images/val/._a.png"):
        (folder / hidden).write_bytes(b"\0\5\x16\7")
    assert len(data_formats.read_folder(folder, "yolo")) == 2


@pytest.mark.parametrize("name", ["labels.txt", "README.dataset.txt", ".ipynb_checkpoints/a-checkpoint.txt"])
def test_texts_without_boxes_beside_labels_are_no_labels(tmp_path: Path, name: str) -> None:
    folder = yolo(tmp_path)
    other = folder / "labels" / name
    other.parent.mkdir(exist_ok=True)
    other.write_text("spacecraft\n")
    assert len(data_formats.read_folder(folder, "yolo")) == 2


def test_labels_of_a_picture_that_is_missing_are_refused(tmp_path: Path) -> None:
    folder = yolo(tmp_path)
    (folder / "labels" / "val" / "b.txt").write_text("")
    (folder / "images" / "val" / "b.png").rename(folder / "images" / "val" / "b.jp2")
    with pytest.raises(DatasetError, match=r"b.txt: found no picture of this name .*, expected one \(.bmp,"):
        data_formats.read_folder(folder, "yolo")


def test_labels_of_no_picture_are_refused(tmp_path: Path) -> None:
    folder = yolo(tmp_path)
    (folder / "labels" / "val").rename(folder / "labels" / "train")
    with pytest.raises(DatasetError, match="nor that of another picture"):
        data_formats.read_folder(folder, "yolo")


@pytest.mark.parametrize(("form", "make"), [("speed", speed_plus), ("spark", spark), ("yolo", yolo)])
def test_the_command_evaluates_each_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], form: str, make: Callable[[Path], Path]
) -> None:
    assert main.main(["detector", "evaluate", str(make(tmp_path)), "--format", form, "--limit", "2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["images"] == 2


def test_a_folder_without_annotations_is_refused_with_the_formats_that_there_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = yolo(tmp_path)
    assert main.main(["detector", "evaluate", str(folder)]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert f"{folder}: found no annotations.json" in line
    assert "--format speed, spark or yolo" in line


@pytest.mark.parametrize("words", [["--limit", "0", "--format", "yolo"], ["--limit", "3"], ["--labels", "x.json"]])
def test_options_that_do_not_belong_together_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    assert main.main(["detector", "evaluate", str(tmp_path), *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
