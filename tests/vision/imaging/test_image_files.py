"""Image files are read as upright codes; other files are refused."""

import struct
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from rpojax.vision.imaging.image_files import PIXEL_LIMIT, ImageFileError, decode_image, read_image

GREY = np.arange(20 * 30, dtype=np.uint8).reshape(20, 30)


def test_grey_palette_alpha_and_16_bit_give_same_codes(tmp_path: Path) -> None:
    expected = np.repeat(GREY[..., None] / 255.0, 3, axis=2)
    opaque = np.dstack([GREY, GREY, GREY, np.full_like(GREY, 255)])
    images = {
        "grey": Image.fromarray(GREY),
        "color": Image.fromarray(np.dstack([GREY] * 3)),
        "palette": Image.fromarray(GREY).convert("P"),
        "alpha": Image.fromarray(opaque),
        "grey_alpha": Image.fromarray(opaque).convert("LA"),
        "deep": Image.fromarray(GREY.astype(np.uint16) * 257),
    }
    for name, image in images.items():
        path = tmp_path / f"{name}.png"
        image.save(path)
        codes = read_image(path)
        assert codes.dtype == np.float32
        np.testing.assert_allclose(codes, expected, atol=1e-4, err_msg=name)


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize(("bits", "is_noted"), [(16, False), (14, True), (12, True), (10, True)])
def test_a_picture_with_codes_of_fewer_bits_is_noticed(
    tmp_path: Path, bits: int, is_noted: bool, channels: int
) -> None:
    path = tmp_path / "deep.png"
    codes = np.full((2, 2, channels), 2**bits - 1, np.uint16)
    codes[..., 3:] = 2**16 - 1
    assert cv2.imwrite(str(path), codes)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        read_image(path)
    assert [f"no code of 16 bit is above {2**bits - 1}" in str(each.message) for each in found] == [True] * is_noted


def test_transparent_pixels_are_black(tmp_path: Path) -> None:
    pixels = np.full((8, 8, 4), 200, np.uint8)
    pixels[:, :4, 3] = 0
    pixels[:, 4:, 3] = 255
    Image.fromarray(pixels).save(tmp_path / "a.png")
    codes = read_image(tmp_path / "a.png")
    assert codes[:, :4].max() == 0.0
    np.testing.assert_allclose(codes[:, 4:], 200 / 255, atol=1e-6)


def test_exif_orientation_is_applied(tmp_path: Path) -> None:
    pixels = np.zeros((16, 40, 3), np.uint8)
    pixels[:, :8] = 255
    exif = Image.Exif()
    exif[0x0112] = 6  # rotate by 90 degrees clockwise
    Image.fromarray(pixels).save(tmp_path / "a.jpg", exif=exif, quality=95)
    codes = read_image(tmp_path / "a.jpg")
    assert codes.shape == (40, 16, 3)
    assert codes[:6].min() > 0.9
    assert codes[12:].max() < 0.1


def animated(path: Path) -> None:
    frames = [Image.fromarray(GREY), Image.fromarray(255 - GREY)]
    frames[0].save(path, "PNG", save_all=True, append_images=frames[1:])


def gif(path: Path) -> None:
    Image.fromarray(GREY).save(path, "GIF")


def truncated(path: Path) -> None:
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)).save(path, "PNG")
    path.write_bytes(path.read_bytes()[:4000])


def bomb(path: Path) -> None:
    """A PNG whose header claims 12000 x 12000 pixels."""

    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    header = struct.pack(">IIBBBBB", 12000, 12000, 8, 2, 0, 0, 0)
    packed = zlib.compress(bytes(1000))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", packed) + chunk(b"IEND", b""))


def huge_bomb(path: Path) -> None:
    bomb(path)
    content = bytearray(path.read_bytes())
    content[16:24] = struct.pack(">II", 60000, 60000)
    content[29:33] = struct.pack(">I", zlib.crc32(bytes(content[12:29])))
    path.write_bytes(bytes(content))


def empty(path: Path) -> None:
    path.write_bytes(b"")


def text(path: Path) -> None:
    path.write_text("a text")


def folder(path: Path) -> None:
    path.mkdir()


def nothing(path: Path) -> None:
    assert not path.exists()


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (animated, "2 frames"),
        (gif, "GIF"),
        (truncated, "cannot be read"),
        (bomb, "12000 x 12000"),
        (huge_bomb, "pixels"),
        (empty, "an empty file"),
        (text, "something else"),
        (folder, "cannot be read"),
        (nothing, "cannot be read"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_unusable_file_is_an_error_of_one_line(tmp_path: Path, make: Callable[[Path], None], found: str) -> None:
    path = tmp_path / "image.png"
    make(path)
    with pytest.raises(ImageFileError, match=found) as error:
        read_image(path)
    assert "expected" in str(error.value)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(("mode", "found"), [("F", "floating-point numbers"), ("I", "codes 0 to 70000")])
def test_other_numbers_than_codes_are_refused(tmp_path: Path, mode: str, found: str) -> None:
    numbers = np.array([[0, 70000]], np.float32 if mode == "F" else np.int32)
    Image.fromarray(numbers).save(tmp_path / "a.tiff")
    with pytest.raises(ImageFileError, match=found):
        decode_image(tmp_path / "a.tiff")


def test_pixel_limit_is_above_45_and_below_100_megapixels() -> None:
    assert 8256 * 5504 < PIXEL_LIMIT < 100_000_000
