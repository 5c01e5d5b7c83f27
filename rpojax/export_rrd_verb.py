"""The verb `rpojax export-rrd`: one run as a recording for the rerun viewer."""

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from rpojax import console
from rpojax.errors import RpojaxError
from rpojax.machine import prepare_jax
from rpojax.outputs import claim
from rpojax.verb_parts import AsJson, Folder, NoCache, Status, print_json

if TYPE_CHECKING:
    from rpojax.interop.flight import Flight
    from rpojax.interop.rerun_log import Shots


def export_rrd(
    directory: Folder,
    *,
    run_id: Annotated[int, arg(metavar="I", help="Run to show.")],
    out: Annotated[Path, arg(metavar="FILE", help="Recording to write (.rrd).")],
    every: Annotated[int, arg(metavar="N", help="Ticks from one picture of a rendered camera to the next.")] = 1,
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False,
    as_json: AsJson = False,
    no_cache: NoCache = False,
) -> int:
    """One run for the rerun viewer: both craft, the camera and plots; flown again where no history holds attitudes."""
    claim(out, force, (".rrd",))
    if every < 1:
        raise RpojaxError(f"--every: found {every}, expected at least 1")
    prepare_jax(cache=not no_cache)
    from rpojax.campaign.store import Campaign
    from rpojax.interop import flight as flights
    from rpojax.interop import rerun_log

    rerun_log.check()
    found = Campaign(directory)
    with console.counting(f"flying run {run_id} again", quiet=as_json) as watch:
        flight = flights.flight_of(found, run_id, watch)
    with console.counting("taking pictures", quiet=as_json) as watch:
        written = rerun_log.write(flight, out, _shots(flight, every, watch))
    told = {"file": str(out), **dataclasses.asdict(written), "flown_again": flight.again, "moved_m": flight.moved_m}
    told.pop("path")
    if as_json:
        print_json(told)
    else:
        if flight.moved_m is not None:
            print(f"flown again for the attitudes; from the kept history it differs by at most {flight.moved_m:.2g} m")
        print(out)
    return Status.DONE


def _shots(flight: "Flight", every: int, watch: Callable[..., None]) -> "Shots | None":
    """Pictures of a rendered camera, None of the others, which take none."""
    if flight.file.camera.model != "rendered":
        return None
    from rpojax.campaign import filming

    ticks = range(0, flight.ticks, every)

    def counted() -> "Iterator[tuple]":
        pictures = filming.pictures(flight.file, flight.seed, flight.run_id, flight.channels, ticks, flight.population)
        for count, shot in enumerate(pictures):
            yield shot
            watch(count + 1, len(ticks))

    return counted()
