"""Blocks and histories of a campaign with lost files, which a resume simulates again. Free of jax, to be read fast.

A lost file is missing or cut short. A file of its full size with other values is not lost but changed: it is refused
when it is read, and never replaced without a word.
"""

from collections.abc import Mapping
from pathlib import Path

from rpojax.campaign.storage import atomic_files, safe_paths
from rpojax.campaign.storage.arrays import array_files
from rpojax.campaign.storage.arrays.array_files import LostFile
from rpojax.campaign.storage.block_manifests import Manifest
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.errors import ResultError


def lost_blocks(
    directory: Path, configuration: CampaignConfiguration, manifests: Mapping[int, Manifest]
) -> dict[int, LostFile]:
    """Block of a manifest -> a lost file of its arrays or histories, in order of the blocks.

    The surface of the target counts to the first block. The histories are those that are there: one may be deleted.

    Raises:
        ResultError: a path leads out of the folder.
    """
    found: dict[int, LostFile] = {}
    for name in sorted({name for entry in manifests.values() for name in entry.sha256}):
        for block, lost in array_files.lost_of_group(directory, name, manifests).items():
            if block not in found and (lost.is_there or not _has_all(directory, configuration, name, block, manifests)):
                found[block] = lost
    first = min(manifests, default=0)
    if manifests and "coverage" in manifests[first].sha256 and (lost := _lost_surface(directory)):
        found.setdefault(first, lost)
    for run_id in array_files.stored_history_ids(
        directory, configuration.options.first_run, configuration.options.runs
    ):
        block = (run_id - configuration.options.first_run) // configuration.block_size
        if block in manifests and block not in found and (lost := lost_history(directory, run_id)):
            found[block] = lost
    return dict(sorted(found.items()))


def lost_history(directory: Path, run_id: int) -> LostFile | None:
    """A lost file of a history, unless another process has removed it, which begins with what says that it is there.

    Raises:
        ResultError: a path leads out of the folder.
    """
    name = f"histories/{run_id}"
    lost = array_files.lost_of_whole_group(directory, name)
    return lost if (directory / "results.zarr" / name / array_files.METADATA).exists() else None


def _has_all(
    directory: Path,
    configuration: CampaignConfiguration,
    name: str,
    block: int,
    manifests: Mapping[int, Manifest],
) -> bool:
    """Whether a block has all of a group that its manifest names, though blocks of newer versions have more arrays."""
    # Imported here because zarr takes longer to import than all else, and a whole campaign does without.
    from rpojax.campaign.storage.arrays import zarr_reader

    try:
        zarr_reader.read_group(directory, configuration, name, {block: manifests[block]})
    except ResultError:
        return False
    return True


def _lost_surface(directory: Path) -> LostFile | None:
    """A lost file of the target's surface; the metadata of its group, written last, say that it is complete."""
    metadata = _surface_metadata(directory)
    return (
        array_files.lost_of_whole_group(directory, "surface")
        if metadata.exists()
        else LostFile(metadata, is_there=False)
    )


def _surface_metadata(directory: Path) -> Path:
    return directory / "results.zarr" / "surface" / array_files.METADATA


def remove_lost_surface(directory: Path) -> None:
    """Removes what says that the target's surface is whole, if a file of it is lost; the next block writes it anew.

    Raises:
        UnfinishedError: it cannot be removed.
        ResultError: its path contains a symbolic link.
    """
    if _lost_surface(directory) is not None:
        metadata = _surface_metadata(directory)
        safe_paths.check_no_links(directory, metadata)
        atomic_files.remove(metadata)
