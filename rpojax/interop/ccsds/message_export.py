"""Export of a run's orbits and attitudes as messages of the CCSDS, a file for each spacecraft."""

import datetime
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, Literal, get_args

from rpojax.campaign.storage.atomic_outputs import check_replaceable, write_atomically
from rpojax.interop.ccsds import navigation_messages
from rpojax.interop.spacecraft_states import SpacecraftStates

MessageKind = Literal["oem", "aem", "opm"]
MESSAGE_KINDS: Final[tuple[MessageKind, ...]] = get_args(MessageKind)

_WRITERS: Final[dict[MessageKind, Callable[[SpacecraftStates, datetime.datetime], str]]] = {
    "oem": navigation_messages.oem,
    "aem": navigation_messages.aem,
    "opm": navigation_messages.opm,
}


def message_paths(out: Path, spacecraft: Sequence[str]) -> list[Path]:
    """Files of each spacecraft: `NAME_servicer.oem` and `NAME_target.oem` for `NAME.oem`."""
    return [out.with_name(f"{out.stem}_{name}{out.suffix}") for name in spacecraft]


def check_messages(out: Path, spacecraft: Sequence[str], force: bool) -> None:
    """Refuses to write over files that exist unless `force` is set.

    Raises:
        OutputError: naming the file.
    """
    check_replaceable(message_paths(out, spacecraft), force)


def write_messages(states: list[SpacecraftStates], kind: MessageKind, out: Path) -> list[Path]:
    """Writes a message for each spacecraft; returns the paths of the files.

    Raises:
        OutputError: a file cannot be written.
    """
    created = datetime.datetime.now(datetime.UTC).replace(tzinfo=None)
    texts = [_WRITERS[kind](each, created) for each in states]
    paths = message_paths(out, [each.spacecraft for each in states])
    return [write_atomically(path, text.encode()) for path, text in zip(paths, texts, strict=True)]
