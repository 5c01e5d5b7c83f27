"""Reads back every export of one run by libraries that are not ours, and prints the largest differences.

    python experiments/export/read_back.py out/inspection --run-id 0 --out out/exported

The campaign needs no history of the run but that of `--histories`; orbits and attitudes are compared with a replay.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

import rpojax
from rpojax.interop import ccsds_messages, czml_document, run_replay, spacecraft_states
from rpojax.interop.spacecraft_states import SpacecraftStates

TABLES = ("metrics", "draws", "traces", "history")


def main() -> None:
    """Exports, reads back, compares and prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--run-id", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    campaign = rpojax.Campaign(arguments.campaign)
    run = run_replay.replay_servicers(campaign, arguments.run_id, spacecraft_states.observe_tick)[0]
    states = spacecraft_states.replayed_states([run], campaign)
    found: dict[str, Any] = {"ticks": run.ticks}
    for kind in ccsds_messages.MESSAGE_KINDS:
        paths = ccsds_messages.write_messages(states, kind, arguments.out / f"run.{kind}")
        for path, each in zip(paths, states, strict=True):
            found[path.name] = MESSAGES[kind](path, each) | {"bytes": path.stat().st_size}
    scene = arguments.out / "run.czml"
    scene.write_text(czml_document.czml(states, czml_document.shapes_of([run])))
    found[scene.name] = czml_differences(scene, states) | {"bytes": scene.stat().st_size}
    for form in ("csv", "parquet", "mat", "npz"):
        rpojax.export(campaign, arguments.out / f"r.{form}", form, TABLES, run_id=arguments.run_id, force=True)
        found[form] = {"range_difference_m": range_difference(form, arguments.out, campaign, arguments.run_id)}
    print(json.dumps(found, indent=2))


def oem_differences(path: Path, states: SpacecraftStates) -> dict[str, float]:
    """By the library `oem`."""
    from oem import OrbitEphemerisMessage

    read = OrbitEphemerisMessage.open(path).states
    position = 1e3 * np.array([each.position for each in read])
    velocity = 1e3 * np.array([each.velocity for each in read])
    return {
        "position_m": float(np.abs(position - states.position_m).max()),
        "velocity_m_s": float(np.abs(velocity - states.velocity_m_s).max()),
    }


def aem_differences(path: Path, states: SpacecraftStates) -> dict[str, float]:
    """By the library `ccsds-ndm`, and SciPy's rotations."""
    from ccsds_ndm.ndm_io import NdmIo

    message: Any = NdmIo().from_path(path)
    rows = [each.quaternion_state.quaternion for each in message.body.segment[0].data.attitude_state]
    read = Rotation.from_quat([[float(each.q1), float(each.q2), float(each.q3), float(each.qc)] for each in rows])
    flown = Rotation.from_quat(np.roll(states.q, -1, axis=1))
    return {"angle_rad": float((read * flown).magnitude().max())}


def opm_differences(path: Path, states: SpacecraftStates) -> dict[str, float]:
    """By the library `ccsds-ndm`."""
    from ccsds_ndm.ndm_io import NdmIo

    message: Any = NdmIo().from_path(path)
    vector = message.body.segment.data.state_vector
    position = 1e3 * np.array([float(each.value) for each in (vector.x, vector.y, vector.z)])
    return {"position_m": float(np.abs(position - states.position_m[0]).max())}


def czml_differences(path: Path, states: list[SpacecraftStates]) -> dict[str, float]:
    """By the library `czml3`; attitudes are those between the spacecraft, which do not depend on the Earth's."""
    from czml3 import Packet

    packets = {each["id"]: Packet(**each) for each in json.loads(path.read_text())}
    differences, read, simulated = [], [], []
    for each in states:
        packet: Any = packets[each.spacecraft]
        rows = np.reshape(packet.position.cartesian.values, (-1, 4))
        differences.append(np.abs(rows[:, 1:] - each.position_m).max())
        read.append(Rotation.from_quat(np.reshape(packet.orientation.unitQuaternion.values, (-1, 5))[:, 1:]))
        simulated.append(Rotation.from_quat(each.q, scalar_first=True))
    between = read[1].inv() * read[0] * (simulated[1] * simulated[0].inv()).inv()
    return {"position_m": float(max(differences)), "angle_rad": float(between.magnitude().max())}


MESSAGES = {"oem": oem_differences, "aem": aem_differences, "opm": opm_differences}


def range_difference(form: str, out: Path, campaign: rpojax.Campaign, run_id: int) -> float:
    """Largest difference of the trace of the range, read by pandas, pyarrow, SciPy or NumPy."""
    if form == "csv":
        import pandas

        read = pandas.read_csv(out / "r_traces.csv", float_precision="round_trip")["range_m"].to_numpy()
    elif form == "parquet":
        import pyarrow.parquet

        read = pyarrow.parquet.read_table(out / "r_traces.parquet")["range_m"].to_numpy()
    elif form == "mat":
        read = loadmat(out / "r.mat", squeeze_me=True)["traces"]["range_m"].item()
    else:
        with np.load(out / "r.npz") as content:
            read = content["traces/range_m"]
    row = int(np.flatnonzero(campaign.run_ids == run_id)[0])
    return float(np.abs(np.asarray(read, dtype=np.float32) - campaign.traces["range_m"][row]).max())


if __name__ == "__main__":
    main()
