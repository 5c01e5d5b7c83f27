"""Motion along any kind of reference trajectory."""

from types import ModuleType
from typing import Any, Final

from jaxtyping import Array, Float

from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.flight.guidance.references import approach, arc, fly_around, hold, relative_orbit, retreat, transfer
from rpojax.flight.guidance.references.phase_entry import PhaseEntry

_MODULES: Final[dict[type, ModuleType]] = {
    hold.Hold: hold,
    relative_orbit.RelativeOrbit: relative_orbit,
    transfer.Transfer: transfer,
    fly_around.FlyAround: fly_around,
    approach.Approach: approach,
    retreat.Retreat: retreat,
    arc.Arc: arc,
}


def reference_state(
    *, reference: Any, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Float[Array, ""]
) -> Float[Array, "6"]:
    """Desired relative state [m, m/s] `elapsed` [s] after the entry, with the target's `orbit` then.

    It is in the frame of its phase, as the entry: H, or the target's own.
    """
    return _MODULES[type(reference)].state(reference, entry, orbit, elapsed)


def end_position(reference: Any, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Float[Array, ""]) -> Float[Array, "3"]:
    """Position [m], in the frame of its phase, at which a reference ends; that at the asked time if it has no end."""
    module = _MODULES[type(reference)]
    if hasattr(module, "end_position"):
        return module.end_position(reference, entry)
    return module.state(reference, entry, orbit, elapsed)[:3]
