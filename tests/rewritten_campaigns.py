"""Campaign folders rewritten as a whole, consistently: what no seal can show."""

import json
from pathlib import Path
from typing import Any

from rpojax.campaign.storage import campaign_configuration
from rpojax.campaign.storage.arrays import zarr_encoding, zarr_reader
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.campaign.storage.campaign_seal import array_binding, sealed


def rewrite_campaign(directory: Path, **entries: Any) -> None:
    """Changes entries of a folder's campaign.json, and binds all blocks, histories and the surface to it anew."""
    before = Campaign(directory)
    manifests, histories = before.manifests, {run: before.history(run) for run in before.history_ids}
    groups = {name for entry in manifests.values() for name in entry.sha256}
    blocks = {
        block: {
            group: zarr_reader.read_group(directory, before.configuration, group, {block: entry})
            for group in groups
            if group in entry.sha256
        }
        for block, entry in manifests.items()
    }
    surface = before.surface
    path = directory / "campaign.json"
    path.write_text(json.dumps(sealed(json.loads(path.read_text()) | entries)))
    configuration = campaign_configuration.read(directory)
    first = configuration.options.first_run
    for block, arrays in blocks.items():
        entry, place = manifests[block], directory / "manifest" / f"{block:06d}.json"
        digests = {
            group: zarr_encoding.digest(
                values, array_binding(configuration.seal, group, first + entry.first, entry.count)
            )
            for group, values in arrays.items()
        }
        record = json.loads(place.read_text()) | {"campaign_seal": configuration.seal, "sha256": digests}
        place.write_text(json.dumps(sealed(record)))
    for run, channels in histories.items():
        _rewrite_digest(
            directory / "results.zarr" / "histories" / str(run),
            zarr_encoding.digest(channels, array_binding(configuration.seal, "histories", run)),
        )
    if surface:
        binding = array_binding(configuration.seal, "surface", 0, configuration.options.runs)
        _rewrite_digest(directory / "results.zarr" / "surface", zarr_encoding.digest(surface, binding))


def _rewrite_digest(folder: Path, digest: str) -> None:
    (folder / "zarr.json").write_bytes(zarr_encoding.group_metadata({"sha256": digest}))
