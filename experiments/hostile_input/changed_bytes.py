"""Changes single bytes and single JSON entries of a finished campaign folder, one at a time, and reads it again.

Every change must be refused, or be without any effect on what the folder tells; a changed report is written again by a
resume. The exit status is 0 if there is no other case.
"""

import argparse
import json
import random
import shutil
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rpojax.campaign.storage import folder_creation
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError
from rpojax.report.page import written_report

sys.path.append(str(Path(__file__).parents[2] / "tests" / "hostile"))
from hostile_folders import json_fields  # pyright: ignore[reportMissingImports]

Check = Callable[[Path], bool]
"""Whether a folder tells what it told before; raises an error of the package where it refuses."""


def main() -> int:
    """Changes bytes and entries, and prints how many were refused, harmless or neither."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="finished campaign, which is copied")
    parser.add_argument("--copy", type=Path, required=True, help="folder to make")
    parser.add_argument("--positions", type=int, default=500, help="for each kind of file")
    parser.add_argument("--seed", type=int, default=0)
    found = parser.parse_args()
    shutil.rmtree(found.copy, ignore_errors=True)
    copy = Path(shutil.copytree(found.folder, found.copy))
    kinds = _kinds(copy)
    rng, third = random.Random(found.seed), 0
    print(
        "| kind of file | files | bytes changed | refused | harmless | entries changed | refused | harmless | neither |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name, (files, check) in kinds.items():
        by_byte = _bytes(files, check, copy, rng, found.positions)
        by_entry = _entries([path for path in files if path.suffix == ".json"], check, copy)
        neither = by_byte["neither"] + by_entry["neither"]
        third += neither
        counts = (by_byte.total(), by_byte["refused"], by_byte["harmless"])
        entries = (by_entry.total(), by_entry["refused"], by_entry["harmless"])
        print(f"| {name} | {len(files)} | {' | '.join(map(str, (*counts, *entries, neither)))} |", flush=True)
    return 1 if third else 0


def _kinds(folder: Path) -> dict[str, tuple[list[Path], Check]]:
    """Kind of file -> its files, and how what depends on them is read."""
    results = folder / "results.zarr"
    groups = sorted(path.name for path in results.iterdir() if path.is_dir() and path.name != "histories")
    identity = _unchanged_identity(folder)
    kinds: dict[str, tuple[list[Path], Check]] = {
        "`campaign.json`": ([folder / "campaign.json"], identity),
        "manifests": (sorted((folder / "manifest").glob("*.json")), identity),
        "`scenario.toml`": ([folder / "scenario.toml"], identity),
        "`report.json`": ([folder / "report.json"], _report_as_written(folder)),
        "`report.html`": ([folder / "report.html"], _report_as_written(folder)),
        "figures": (sorted((folder / "figures").iterdir()), _report_as_written(folder)),
    }
    for group in groups:
        files = sorted(path for path in (results / group).rglob("*") if path.is_file())
        check = _unchanged_group(folder, group)
        kinds[f"`{group}`, metadata"] = ([path for path in files if path.name == "zarr.json"], check)
        kinds[f"`{group}`, values"] = ([path for path in files if path.name != "zarr.json"], check)
    files = sorted(path for path in (results / "histories").rglob("*") if path.is_file())
    check = _unchanged_histories(folder)
    kinds["histories, metadata"] = ([path for path in files if path.name == "zarr.json"], check)
    kinds["histories, values"] = ([path for path in files if path.name != "zarr.json"], check)
    return kinds


def _outcome(path: Path, content: bytes, check: Check, folder: Path) -> str:
    before = path.read_bytes()
    if content == before:
        return "harmless"
    path.write_bytes(content)
    try:
        return "harmless" if check(folder) else "neither"
    except RpojaxError:
        return "refused"
    finally:
        path.write_bytes(before)


def _bytes(files: list[Path], check: Check, folder: Path, rng: random.Random, count: int) -> Counter[str]:
    found: Counter[str] = Counter()
    for _ in range(count):
        path = rng.choice(files)
        content = bytearray(path.read_bytes())
        content[rng.randrange(len(content))] ^= rng.randrange(1, 256)
        found[_outcome(path, bytes(content), check, folder)] += 1
    return found


def _entries(files: list[Path], check: Check, folder: Path) -> Counter[str]:
    found: Counter[str] = Counter()
    for path in files:
        content = json.loads(path.read_text())
        for field in list(json_fields(content)):
            inner = content
            for key in field[:-1]:
                inner = inner[key]
            before, inner[field[-1]] = inner[field[-1]], "changed"
            found[_outcome(path, json.dumps(content).encode(), check, folder)] += 1
            inner[field[-1]] = before
    return found


def _unchanged_identity(folder: Path) -> Check:
    """Everything that is known of a folder beside its arrays, which are bound to it by digests."""

    def read(place: Path) -> str:
        found = Campaign(place)
        folder_creation.check_scenario_copy(place, found.configuration)
        return repr((found.info, found.manifests, found.run_ids, found.history_ids, found.missing_blocks()))

    expected = read(folder)
    return lambda place: read(place) == expected


def _unchanged_group(folder: Path, group: str) -> Check:
    def read(place: Path) -> dict[str, bytes]:
        return {name: np.asarray(values).tobytes() for name, values in Campaign(place)._read(group).items()}

    expected = read(folder)
    return lambda place: read(place) == expected


def _unchanged_histories(folder: Path) -> Check:
    def read(place: Path) -> dict[int, dict[str, bytes]]:
        found = Campaign(place)
        return {run: {name: v.tobytes() for name, v in found.history(run).items()} for run in found.history_ids}

    expected = read(folder)
    return lambda place: read(place) == expected


def _report_as_written(folder: Path) -> Check:
    seal = Campaign(folder).configuration.seal
    assert written_report.is_as_written(folder, seal), "the folder has no whole report"

    def check(place: Path) -> bool:
        if written_report.is_as_written(place, seal):
            return True
        raise RpojaxError("the report is not as it was written: a resume writes it again")

    return check


if __name__ == "__main__":
    sys.exit(main())
