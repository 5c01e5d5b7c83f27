"""Runs inputs that once broke the commands, with the package of a chosen tree, and prints how each ended.

`--tree` is a checkout of this repository: an older one shows what was, this one what is.
"""

import argparse
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

LONGEST_S = 40.0
LONGEST_CAMPAIGN_S = 600.0
SHORT = ("--set", "duration_s=200", "--no-film")


@dataclass(frozen=True)
class Row:
    """One input: its class, what it is, the words of the command, and what is prepared before it."""

    kind: str
    what: str
    words: Sequence[str]
    environment: dict[str, str] = field(default_factory=dict)
    interrupt_s: float | None = None
    stdout: str = ""
    program: str = ""


def main() -> int:
    """Runs all rows and prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[2])
    parser.add_argument("--only", default="", help="classes that contain this text")
    found = parser.parse_args()
    # A job in the background ignores SIGINT, and so would its children.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    print("| class | input | status | lines | ended | last line |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder, tree = Path(name), found.tree.resolve()
        for row in _rows(folder, tree):
            if found.only in row.kind:
                print(_run(row, tree, folder), flush=True)
    return 0


def _run(row: Row, tree: Path, folder: Path) -> str:
    longest_s = LONGEST_CAMPAIGN_S if row.words[:1] == ("campaign",) else LONGEST_S
    words = [sys.executable, "-c", row.program] if row.program else [sys.executable, "-m", "rpojax", *row.words]
    environment = {**os.environ, "PYTHONPATH": str(tree), **row.environment}
    began = time.monotonic()
    with Path(row.stdout or os.devnull).open("w") as given:
        out = given.fileno() if row.stdout else subprocess.PIPE
        process = subprocess.Popen(
            words, env=environment, cwd=folder, stdout=out, stderr=subprocess.PIPE, text=True, errors="replace"
        )
        try:
            if row.interrupt_s is not None:
                time.sleep(row.interrupt_s)
                process.send_signal(signal.SIGINT)
            printed, err = process.communicate(timeout=longest_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return f"| {row.kind} | {row.what} | none | | no answer in {longest_s:.0f} s | |"
    lines = [line for line in (err or "").splitlines() if line.strip()]
    ended = "traceback" if any("Traceback" in line for line in lines) else "lines" if len(lines) > 1 else "one line"
    ended = ended if lines else "silent"
    last = _shown(lines[-1] if lines else "")
    if "--json" in row.words:
        last += f"; JSON {len((printed or '').strip()) > 0}"
    longest = max(map(len, lines), default=0)
    status = process.returncode if process.returncode >= 0 else 128 - process.returncode
    spent = f"{ended}, {time.monotonic() - began:.0f} s, longest {longest}"
    return f"| {row.kind} | {row.what} | {status} | {len(lines)} | {spent} | {last} |"


def _shown(text: str) -> str:
    text = re.sub(r"/tmp/\w+/", "", text)
    return repr(text[:130])[1:-1].replace("|", "\\|")


def _rows(folder: Path, tree: Path) -> list[Row]:
    runs = folder / "runs"
    subprocess.run(
        [sys.executable, "-m", "rpojax", "campaign", "inspection", "--runs", "3", "--out", str(runs), *SHORT],
        env={**os.environ, "PYTHONPATH": str(tree)},
        cwd=folder,  # Python looks for packages where it is started
        capture_output=True,
        check=False,
    )
    return [*_report(folder), *_forged(folder, runs), *_files(folder, runs), *_assets(folder), *_lines(folder, runs)]


def _write(folder: Path, name: str, text: str) -> str:
    (folder / name).write_text(text)
    return name


def _copy(folder: Path, runs: Path, name: str, change: Callable[[Path], object]) -> str:
    place = Path(shutil.copytree(runs, folder / name))
    change(place)
    return name


def _edited(path: Path, **entries: object) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | entries))


def _report(folder: Path) -> list[Row]:
    narrow = _write(folder, "narrow.toml", 'extends = "inspection"\n' + _NARROW)
    words = ("campaign", narrow, "--runs", "12", "--out", "narrow", *SHORT)
    return [Row("report", "dispersion of width 1e-200, 12 runs", words)]


_NARROW = '[[dispersions]]\nkey = "initial.relative_velocity_m_s"\nkind = "normal"\nsigma = 1e-200\n'


def _forged(folder: Path, runs: Path) -> list[Row]:
    def swap(place: Path) -> None:
        histories = place / "results.zarr" / "histories"
        (histories / "0").rename(histories / "x")
        (histories / "1").rename(histories / "0")
        (histories / "x").rename(histories / "1")

    def requirement(place: Path) -> None:
        content = json.loads((place / "campaign.json").read_text())
        for each in content["scenario"]["requirements"]:
            each["limit"] = 1e9 if each["bound"] == "at most" else -1e9
        (place / "campaign.json").write_text(json.dumps(content))

    def manifest(place: Path) -> None:
        path = place / "manifest" / "000000.json"
        content = json.loads(path.read_text())
        for group in ("drawn", "used"):
            content["sha256"].pop(group)
        path.write_text(json.dumps(content))

    def shape(place: Path) -> None:
        _edited(place / "results.zarr" / "traces" / "range_m" / "zarr.json", shape=[3, 4 * 10**11])

    changes: dict[str, Callable[[Path], object]] = {
        "histories swapped": swap,
        "seed changed": lambda place: _edited(place / "campaign.json", seed=5),
        "scenario hash changed": lambda place: _edited(place / "campaign.json", scenario_hash="0" * 64),
        "limits of requirements changed": requirement,
        "dtype changed": lambda place: _edited(place / "campaign.json", dtype="float32"),
        "digests of drawn and used values deleted": manifest,
        "shape of 4 x 10^11": shape,
    }
    rows = []
    for number, (what, change) in enumerate(changes.items()):
        copy = _copy(folder, runs, f"forged{number}", change)
        kind = "absurd shapes" if "shape" in what else "results and identity"
        rows.append(Row(kind, f"{what}, `resume`", ("resume", copy)))
    foreign = _copy(folder, runs, "foreign", lambda place: None)
    (folder / foreign / "manifest" / "000000.json").rename(
        folder / foreign / "manifest" / "\u0660\u0660\u0660\u0660\u0660\u0660.json"
    )
    rows.append(Row("results and identity", "manifest named in Arabic digits, `status`", ("status", foreign)))
    return rows


def _files(folder: Path, runs: Path) -> list[Row]:
    os.mkfifo(folder / "fifo.toml")
    (folder / "loop.toml").symlink_to("loop.toml")

    def fifo(place: Path, name: str) -> None:
        (place / name).unlink()
        os.mkfifo(place / name)

    pipes = {
        name: _copy(folder, runs, f"pipe{number}", lambda place, name=name: fifo(place, name))
        for number, name in enumerate(("campaign.json", "manifest/000000.json", "report.json"))
    }
    deep, keys = "[" * 100_000, "\n".join(f"k{n} = 1" for n in range(800_000))
    digits = _copy(folder, runs, "digits", lambda place: None)
    scenario = json.loads((runs / "campaign.json").read_text())["scenario"]
    path = folder / digits / "campaign.json"
    text = path.read_text().replace(
        f'"duration_s": {json.dumps(scenario["duration_s"])}', '"duration_s": 1' + "0" * 400, 1
    )
    path.write_text(text)
    deeper = _copy(folder, runs, "deeper", lambda place: (place / "campaign.json").write_text(deep))
    base = 'extends = "inspection"\n'
    large = _write(folder, "g.toml", base + "duration_s = 1" + "0" * 400)
    return [
        Row("reads without bound", "scenario `/dev/zero`", ("validate", "/dev/zero")),
        Row("reads without bound", "scenario that is a FIFO", ("validate", "fifo.toml")),
        Row("reads without bound", "extends a FIFO", ("validate", _write(folder, "a.toml", 'extends = "fifo.toml"'))),
        *(Row("reads without bound", f"FIFO as `{name}`, `resume`", ("resume", copy)) for name, copy in pipes.items()),
        Row(
            "superlinear time",
            "dotted key of 20,000 parts",
            ("validate", _write(folder, "b.toml", base + ".".join(["a"] * 20_000) + " = 1")),
        ),
        Row("superlinear time", "800,000 unknown keys", ("validate", _write(folder, "c.toml", base + keys))),
        Row("tracebacks", "TOML of 100,000 levels", ("validate", _write(folder, "d.toml", base + "a = " + deep))),
        Row("tracebacks", "JSON of 100,000 levels", ("status", deeper)),
        Row("tracebacks", "5,000 digits", ("validate", _write(folder, "e.toml", base + "duration_s = " + "9" * 5000))),
        Row("tracebacks", "NUL in a path", ("validate", _write(folder, "f.toml", 'extends = "a\\u0000b"'))),
        Row("tracebacks", "link loop", ("validate", "loop.toml")),
        Row("tracebacks", "10^400 in a folder, `status`", ("status", digits)),
        Row(
            "tracebacks",
            "10^400 in a scenario",
            ("validate", large),
        ),
    ]


def _assets(folder: Path) -> list[Row]:
    header = json.dumps({"a": {"dtype": "F8_E4M3", "shape": [2], "data_offsets": [0, 2]}}).encode()
    (folder / "w.safetensors").write_bytes(struct.pack("<Q", len(header)) + header + b"ab")
    chunk = b"IHDR" + struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    (folder / "large.png").write_bytes(png + b"\0\0\0\0IEND\xaeB`\x82")
    (folder / "set").mkdir()
    coco = {"images": [{"id": 1, "file_name": "../large.png", "width": 60_000, "height": 60_000}], "annotations": []}
    (folder / "set" / "annotations.json").write_text(json.dumps(coco))
    (folder / "boxes").mkdir()
    boxes = {"images": [{"id": 1, "file_name": "a.png", "width": 9, "height": 9}], "annotations": []}
    boxes["annotations"] = [{"image_id": 1, "category_id": 1, "bbox": [0, 0, 1e308, 1e308]}]
    (folder / "boxes" / "annotations.json").write_text(json.dumps(boxes))
    mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
    (folder / "nan.obj").write_text(mesh)
    module = "rpojax.training.synthetic_data"
    return [
        Row("tracebacks", "weights of type F8_E4M3", ("detect", "large.png", "--weights", "w.safetensors")),
        Row("tracebacks", "picture of 60,000 x 60,000", ("detect", "large.png")),
        Row(
            "silent change of input",
            "mesh with a vertex that is NaN",
            (),
            program=f"from {module}.meshes.mesh_files import load_mesh\n"
            "print(load_mesh('nan.obj', center=True).face_count, file=__import__('sys').stderr)",
        ),
        Row(
            "silent change of input",
            "COCO box of 1e308",
            (),
            program=f"from pathlib import Path\nfrom {module}.detection_dataset import summary\n"
            "print(summary(Path('boxes')), file=__import__('sys').stderr)",
        ),
        Row(
            "silent change of input",
            "`file_name` with `..`",
            (),
            program=f"from pathlib import Path\nfrom {module}.detection_dataset import read_dataset\n"
            "read_dataset(Path('set'))",
        ),
    ]


def _lines(folder: Path, runs: Path) -> list[Row]:
    base = 'extends = "inspection"\n'
    long = _write(folder, "h.toml", base + '"' + "k" * 160_000 + '" = 1')
    control = _write(folder, "i.toml", base + '"\\u202e\\u001b[31mx" = 1')
    odd = os.fsdecode(b"odd\xff\xfe")
    shutil.copytree(runs, folder / odd)
    rerun = ("rerun", "runs", "--run-id", "1", "--out", "again", "--no-film")
    return [
        Row("tracebacks", "folder name that is not UTF-8", ("resume", odd)),
        Row("tracebacks", "`/dev/full` as standard output", ("status", "runs"), stdout="/dev/full"),
        Row("tracebacks", "`JAX_PLATFORMS=nonsense`", rerun, environment={"JAX_PLATFORMS": "nonsense"}),
        Row("tracebacks", "`JAX_ENABLE_X64=banana`", rerun, environment={"JAX_ENABLE_X64": "banana"}),
        Row("tracebacks", "Ctrl-C after 0.1 s", ("validate", "inspection"), interrupt_s=0.1),
        Row("poor lines", "unknown command", ("campain", "inspection")),
        Row("poor lines", "usage error with `--json`", ("campaign", "inspection", "--json")),
        Row("poor lines", "key of 160,000 letters", ("validate", long)),
        Row("poor lines", "control and direction characters", ("validate", control)),
        Row("poor lines", "`--set` with a second line", ("validate", "inspection", "--set", "seed=1\nx=2")),
        Row("poor lines", "misspelt key", ("validate", "inspection", "--set", "mas_kg=3")),
        Row("poor lines", "two settings in one `--set`", ("validate", "inspection", "--set", "duration_s=600\nx=2")),
    ]


if __name__ == "__main__":
    sys.exit(main())
