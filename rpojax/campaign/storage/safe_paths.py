"""Paths that stay inside a campaign folder: no part of them may be a symbolic link."""

from pathlib import Path

from rpojax.campaign.storage import atomic_files
from rpojax.errors import ResultError


def check_no_links(root: Path, path: Path) -> None:
    """Refuses a path below `root` that leads elsewhere.

    Raises:
        ResultError: naming the part of the path that is a symbolic link.
    """
    part = root
    for name in path.relative_to(root).parts:
        part = part / name
        if part.is_symlink() or name == "..":
            raise ResultError(f"{part}: found a link that leads elsewhere, expected a file or folder of the campaign")


def make_folder(root: Path, folder: Path) -> None:
    """Makes a folder below `root`, with its parents.

    Raises:
        UnfinishedError: it cannot be made.
        ResultError: a part of its path is a symbolic link.
    """
    check_no_links(root, folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise atomic_files.write_error(folder, error) from None
