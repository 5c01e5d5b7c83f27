"""Options of the commands for scenario files."""

from dataclasses import dataclass
from typing import Annotated

from tyro.conf import Positional, arg

from rpojax.cli.options.arguments import FLAT, AllowPlugin, AsJson, Command, Overrides, Source


@dataclass(frozen=True, kw_only=True)
class KnownFacts:
    """What one knows of a mission; what is left out follows from the rest."""

    mass_kg: Annotated[float | None, arg(metavar="KG", help="Mass of the servicer.")] = None
    thrust_n: Annotated[float | None, arg(metavar="N", help="Thrust of the servicer.")] = None
    target_m: Annotated[
        tuple[float, ...] | None, arg(metavar="M [M M]", help="Body of the target: one side, or three.")
    ] = None
    span_m: Annotated[float | None, arg(metavar="M", help="Target across its panels; none without.")] = None
    target_mesh: Annotated[str | None, arg(metavar="FILE", help="Mesh of the target in place of its sizes.")] = None
    mesh_units: Annotated[str | None, arg(metavar="UNIT", help="Unit of the mesh: m, cm, mm, in or ft.")] = None
    target_mass_kg: Annotated[float | None, arg(metavar="KG", help="Mass of the target.")] = None
    tumble_deg_s: Annotated[float | None, arg(metavar="DEG_S", help="Tumble of the target.")] = None
    size_sigma: Annotated[
        float | None, arg(metavar="SHARE", help="To what share of it the size of the target is known, 1 sigma.")
    ] = None
    altitude_km: Annotated[float | None, arg(metavar="KM", help="Altitude of the orbit.")] = None
    inclination_deg: Annotated[float | None, arg(metavar="DEG", help="Sun-synchronous without, if it can be.")] = None
    local_time_h: Annotated[float | None, arg(metavar="H", help="Local time of the ascending node.")] = None
    beta_deg: Annotated[
        float | None, arg(metavar="DEG", help="In place of the local time: Sun out of the orbit plane.")
    ] = None
    hold_m: Annotated[float | None, arg(metavar="M", help="Distance of the station behind the target.")] = None
    approach_m: Annotated[float | None, arg(metavar="M", help="Distance to which it approaches from there.")] = None
    start_m: Annotated[float | None, arg(metavar="M", help="Distance at the start.")] = None
    lens_deg: Annotated[float | None, arg(metavar="DEG", help="Field of view of the camera.")] = None
    pixels: Annotated[int | None, arg(metavar="PX", help="Pixels along a side of the picture.")] = None
    full_environment: Annotated[
        bool, arg(help="With drag, pressure of sunlight, friction of wheels and all other effects.")
    ] = False


@dataclass(frozen=True, kw_only=True)
class NewCommand(Command):
    """Write a commented scenario: from what one knows of a mission, or one with the keys that people change first.

    What one knows are the flags from --mass-kg on; in a terminal it is asked for if neither one of these nor --extends
    is given. All that is not known is derived, so that it fits, and the file says how.
    """

    work = "scenarios.new:new"

    name: Annotated[Positional[str], arg(metavar="NAME", help="Name of the scenario; the file is NAME.toml.")]
    extends: Annotated[
        str | None, arg(metavar="SCENARIO", help="Packaged scenario whose first keys are written as comments.")
    ] = None
    force: Annotated[bool, arg(help="Replace the file if it is there.")] = False
    facts: Annotated[KnownFacts, FLAT]


@dataclass(frozen=True, kw_only=True)
class ValidateCommand(Command):
    """Check a scenario without running it."""

    work = "scenarios.validate:validate"

    scenario: Source
    overrides: Overrides = ()
    as_json: AsJson = False
    allow_plugin: AllowPlugin = False


@dataclass(frozen=True, kw_only=True)
class SchemaCommand(Command):
    """JSON schema of a scenario, for editors and other tools."""

    work = "scenarios.schema:schema"
    prepares_jax = False

    partial: Annotated[bool, arg(help="Of a file that extends another: no key is required.")] = False


@dataclass(frozen=True, kw_only=True)
class ShowCommand(Command):
    """Show a scenario as it is simulated: value, unit, where each key comes from, and meaning."""

    work = "scenarios.show:show"

    scenario: Source
    key: Annotated[Positional[str], arg(metavar="KEY", help="A key or a section; all of them without it.")] = ""
    overrides: Overrides = ()
    as_json: AsJson = False
    allow_plugin: AllowPlugin = False
