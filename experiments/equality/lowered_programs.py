"""Digests of the programs that campaigns of one servicer compile, to compare two versions of the code in a minute.

python experiments/equality/lowered_programs.py record before.json
python experiments/equality/lowered_programs.py compare before.json after.json

Equal digests of the preparation and of the loop mean the same program, and so the same bits. Others mean nothing: then
`record.py` compares numbers.
"""

import hashlib
import json
import sys
from pathlib import Path

import rpojax

rpojax.prepare_process()

import jax  # noqa: E402

from rpojax.campaign.execution.batch_engine import BatchEngine  # noqa: E402
from rpojax.scenario.loading import scenario_loader  # noqa: E402

SCENARIOS = (
    "inspection",
    "inspection_cold",
    "inspection_eclipse",
    "inspection_faults",
    "inspection_full",
    "inspection_radial",
    "elliptic_rendezvous",
    "fly_around",
    "geo_inspection",
    "inspection_abort",
    "rbar_approach",
    "rendezvous",
    "safety_ellipse",
    "vbar_approach",
)


def digests(name: str) -> list[str]:
    """Digests of the lowered preparation and loop of a packaged scenario, with four runs a batch."""
    engine = BatchEngine(scenario_loader.load(name), 4, jax.devices()[:1])
    loop = next(iter(engine._loop_traces.traces.values()))
    texts = (engine._preparation_trace.lower().as_text(), loop.lower().as_text())
    return [hashlib.sha256(text.encode()).hexdigest()[:16] for text in texts]


def main() -> None:
    """Runs the command of the command line."""
    match sys.argv[1:]:
        case ["record", path]:
            found = {}
            for name in SCENARIOS:
                found[name] = digests(name)
                print(name, *found[name], flush=True)
            Path(path).write_text(json.dumps(found, indent=1) + "\n")
        case ["compare", before, after]:
            one, other = (json.loads(Path(path).read_text()) for path in (before, after))
            same = {name: one[name] == other[name] for name in SCENARIOS}
            for name, is_same in same.items():
                print(f"{name}: {'the same programs' if is_same else 'other programs'}")
            sys.exit(not all(same.values()))
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main()
