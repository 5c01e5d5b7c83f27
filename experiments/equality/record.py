"""Records every metric of fixed campaigns, or compares two such records bit by bit.

python experiments/equality/record.py record before.json
python experiments/equality/record.py compare before.json after.json
"""

import hashlib
import json
import platform
import sys
import tempfile
from pathlib import Path

import numpy as np

import rpojax

rpojax.prepare_process()

SCENARIOS = (
    "inspection",
    "inspection_cold",
    "inspection_eclipse",
    "inspection_faults",
    "inspection_full",
    "inspection_radial",
)
MISSIONS = (
    "elliptic_rendezvous",
    "fly_around",
    "geo_inspection",
    "inspection_abort",
    "rbar_approach",
    "rendezvous",
    "safety_ellipse",
    "vbar_approach",
)
"""Packaged scenarios of several phases."""
CAMPAIGNS: dict[str, tuple[str, int, list[str]]] = {
    **{name: (name, 64, ["duration_s=1000"]) for name in SCENARIOS},
    **{name: (name, 16, ["duration_s=1000"]) for name in MISSIONS},
    "inspection, rendered camera": ("inspection", 4, ["duration_s=300", "camera.model=rendered"]),
    "inspection, statistical camera": ("inspection", 16, ["duration_s=300", "camera.model=statistical"]),
    "inspection, single precision": ("inspection", 16, ["duration_s=300", "precision=single"]),
}
"""Name of a campaign -> scenario, runs, overrides."""


def main() -> None:
    """Runs the command of the command line."""
    match sys.argv[1:]:
        case ["record", path]:
            Path(path).write_text(json.dumps(record(), indent=1, allow_nan=True) + "\n")
        case ["compare", before, after]:
            sys.exit(compare(json.loads(Path(before).read_text()), json.loads(Path(after).read_text())))
        case _:
            sys.exit(__doc__)


def record() -> dict[str, object]:
    """Metrics of all campaigns as numbers, and digests of everything else that they store."""
    found: dict[str, object] = {"machine": platform.processor() or platform.machine(), "rpojax": rpojax.__version__}
    for name, (scenario, runs, overrides) in CAMPAIGNS.items():
        with tempfile.TemporaryDirectory() as folder:
            result = rpojax.run_campaign(rpojax.load(scenario, overrides), runs=runs, out=f"{folder}/out", seed=7)
            found[name] = content(result)
        print(name, "done", flush=True)
    return found


def content(result: rpojax.Campaign) -> dict[str, object]:
    """Metrics of one campaign in full; digests of dispersions, traces and kept histories."""
    arrays = {f"drawn {key}": values for key, values in result.drawn.items()}
    arrays |= {f"used {key}": values for key, values in result.used.items()}
    arrays |= {f"trace {key}": values for key, values in result.traces.items()}
    for run_id in result.history_ids:
        arrays |= {f"history {run_id} {key}": values for key, values in result.history(run_id).items()}
    return {
        "metrics": {key: values.tolist() for key, values in result.metrics.items()},
        "failures": result.failure_reason.tolist(),
        "digests": {key: digest(values) for key, values in arrays.items()},
    }


def digest(values: np.ndarray) -> str:
    """First 16 hexadecimal digits of the SHA-256 of an array's type, shape and bytes."""
    head = f"{values.dtype.str} {values.shape} ".encode()
    return hashlib.sha256(head + np.ascontiguousarray(values).tobytes()).hexdigest()[:16]


def compare(before: dict[str, dict], after: dict[str, dict]) -> int:
    """Prints one line a campaign; 1 if any number differs in any bit, else 0."""
    status = 0
    for name in CAMPAIGNS:
        one, other = before[name], after[name]
        keys = [(part, key) for part in ("metrics", "digests") for key in sorted({*one[part], *other[part]})]
        different = [key for part, key in keys if repr(one[part].get(key)) != repr(other[part].get(key))]
        same = one["failures"] == other["failures"] and not different
        status |= not same
        print(f"{name}: {len(keys)} arrays, {'all equal' if same else f'different: {different[:5]}'}")
    return status


if __name__ == "__main__":
    main()
