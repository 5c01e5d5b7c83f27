"""Sends signals to a campaign at every stage, and resumes it: statuses as documented, and equal results.

The exit status is 0 if every status is 128 and the number of the signal, no traceback is shown after the start of
Python, and every resume ends with the results of a campaign that nothing interrupted.
"""

import argparse
import shutil
import signal
import sys
from pathlib import Path

from rpojax.campaign.storage.campaign_folder import Campaign

sys.path.append(str(Path(__file__).parents[2] / "tests" / "hostile"))
from interrupted_commands import (  # pyright: ignore[reportMissingImports]
    SHORT,
    STAGES,
    run_to_end,
    signalled,
)

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)


def main() -> int:
    """Sends the signals and prints a table of statuses."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder to make")
    parser.add_argument("--stages", nargs="+", choices=[*STAGES], default=[*STAGES])
    found = parser.parse_args()
    shutil.rmtree(found.out, ignore_errors=True)
    found.out.mkdir(parents=True)
    words = ("campaign", "inspection", "--runs", "4", "--block-size", "2", "--no-film", *SHORT)
    assert run_to_end(*words, "--out", str(found.out / "whole")).status in (0, 3)
    whole = Campaign(found.out / "whole").metrics
    faults = 0
    print("| stage | " + " | ".join(number.name for number in SIGNALS) + " |")
    print("|---|" + "---|" * len(SIGNALS))
    for stage in found.stages:
        cells = []
        for number in SIGNALS:
            out = found.out / f"{stage.replace(' ', '_')}_{number.name}"
            ended = signalled(stage, number, (*words, "--out", str(out)), out)
            is_shown = "Traceback" in ended.err and stage != "start of Python"
            text, fault = f"{ended.status}, {ended.wait_s:.1f} s", ended.status != 128 + number or is_shown
            if out.exists():
                status = run_to_end("resume", str(out)).status
                same = all(whole[name].tobytes() == values.tobytes() for name, values in Campaign(out).metrics.items())
                text += f"; resumed {status}, {'equal' if same else 'other'} results"
                fault = fault or status not in (0, 3) or not same
            cells.append(text + (" **no**" if fault else ""))
            faults += fault
        print(f"| {stage} | {' | '.join(cells)} |", flush=True)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
