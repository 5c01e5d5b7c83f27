"""Hostile scenario files, overrides, case tables and orbit messages."""

from pathlib import Path

from case_ledger import Case
from element_sets import TLE
from hostile_values import NUMBERS, SPECIAL_FILES, TEXTS, damaged_bytes, nested, special_path, toml_values
from hypothesis import strategies as st

from rpojax.scenario.checks import nearest_key
from rpojax.scenario.loading import scenario_loader

KEYS = nearest_key._known_keys()
NAMES = scenario_loader.packaged_names()
PACKAGED = Path(scenario_loader.__file__).parents[1] / "packaged"
LISTS = {
    "dispersions": (
        "key",
        "keys",
        "kind",
        "sigma",
        "low",
        "high",
        "values",
        "sigmas",
        "correlation",
        "common",
        "bound",
    ),
    "requirements": ("metric", "bound", "limit", "probability", "consumer_risk", "outcome", "phase", "at"),
    "phases": ("name", "reference", "ends", "duration_s", "kind", "keep_out_m", "abort"),
    "servicers": ("name", "initial", "mass_kg", "servicer", "camera"),
}
"""List of tables -> keys that its tables have, or that one might think of."""
REMOVED = '[[dispersions]]\nkey = "orbit.true_anomaly_deg"\nkind = "none"\n'
NUMBERS_OF_INSPECTION = [
    (f"{section}.{key}", value)
    for section, keys in scenario_loader.load("inspection").model_dump().items()
    if isinstance(keys, dict)
    for key, value in keys.items()
    if isinstance(value, float)
]
"""Keys of `inspection` that hold numbers, with their values."""
OEM = """CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2026-03-20T00:00:00
ORIGINATOR = SOMEBODY
META_START
OBJECT_NAME = A
OBJECT_ID = 2026-001A
CENTER_NAME = EARTH
REF_FRAME = EME2000
TIME_SYSTEM = UTC
START_TIME = 2026-03-20T14:00:00
STOP_TIME = 2026-03-20T14:10:00
META_STOP
2026-03-20T14:00:00 6878.0000 0.0 0.0000 -0.000000 0.0 7.612684
2026-03-20T14:05:00 6502.3079 0.0 2242.0696 -2.481560 0.0 7.196862
2026-03-20T14:10:00 5416.2740 0.0 4239.2052 -4.692022 0.0 5.994821
"""


def scenario_cases(folder: Path) -> st.SearchStrategy[Case]:
    """Scenario files."""
    return st.one_of(
        _with_value(folder), _with_table(folder), _with_structure(folder), _with_bytes(folder), _from_path(folder)
    )


def override_cases() -> st.SearchStrategy[Case]:
    """Overrides of a packaged scenario."""

    @st.composite
    def build(draw: st.DrawFn) -> Case:
        key = draw(st.one_of(st.sampled_from(KEYS), st.sampled_from([f"dispersions.{key}" for key in KEYS[:40]])))
        damage = draw(st.sampled_from(("near nominal", "value", "misspelt", "second line", "parts", "text", "twice")))
        value = draw(toml_values())
        match damage:
            case "near nominal":
                key, nominal = draw(st.sampled_from(NUMBERS_OF_INSPECTION))
                text = [f"{key}={nominal * draw(st.floats(0.99, 1.01))}"]
            case "value" | "twice":
                text = [f"{key}={value}"] * (2 if damage == "twice" else 1)
            case "misspelt":
                at = draw(st.integers(0, len(key) - 1))
                text = [f"{key[:at]}{draw(st.sampled_from('x._-'))}{key[at + 1 :]}={value}"]
            case "second line":
                text = [f"{key}={value}\n{draw(st.sampled_from(KEYS))}={draw(toml_values())}"]
            case "parts":
                text = [".".join(["a"] * draw(st.sampled_from((33, 1000, 20_000)))) + "=1", f"link.{'b.' * 40}c=1"]
            case _:
                text = [draw(st.text(max_size=60))]
        return Case("override", damage, key, lambda: scenario_loader.load("inspection", text))

    return build()


def table_cases(folder: Path) -> st.SearchStrategy[Case]:
    """Case tables in CSV."""

    @st.composite
    def build(draw: st.DrawFn) -> Case:
        keys = draw(st.lists(st.sampled_from((*KEYS[:80], "faults.fault.kind", "", "x" * 300)), min_size=1, max_size=4))
        cells = st.sampled_from((*NUMBERS, *TEXTS[:8], '"', ",", "\n", "\0"))
        rows = [",".join(keys)] + [",".join(draw(cells) for _ in keys) for _ in range(draw(st.integers(0, 3)))]
        damage, content = damaged_bytes("\n".join(rows).encode("utf-8", "replace"), draw)
        if draw(st.booleans()):
            damage, content = "cells", "\n".join(rows).encode("utf-8", "replace")
        if draw(st.integers(0, 9)) == 0:
            key, nominal = draw(st.sampled_from(NUMBERS_OF_INSPECTION))
            keys, damage = [key], "near nominal"
            content = f"{key}\n{nominal * draw(st.floats(0.99, 1.01))}\n".encode()
        file = folder / "table.csv"
        text = 'extends = "inspection"\n[design]\nkind = "table"\nfile = "table.csv"\n'
        return Case("case table", damage, keys[0][:40], lambda: _load(folder, text, (file, content)))

    return build()


def orbit_cases(folder: Path) -> st.SearchStrategy[Case]:
    """Orbit messages and element sets."""

    @st.composite
    def build(draw: st.DrawFn) -> Case:
        name, base = draw(st.sampled_from((("TLE", TLE), ("OEM", OEM), ("OMM in XML", _omm_xml()))))
        how = draw(st.sampled_from(("bytes", "number", "deep", "special")))
        file = folder / "start.txt"
        content, damage, target = base.encode(), how, "start.txt"
        match how:
            case "bytes":
                damage, content = damaged_bytes(content, draw)
            case "number":
                words = base.split(" ")
                words[draw(st.integers(0, len(words) - 1))] = draw(st.sampled_from(NUMBERS))
                content = " ".join(words).encode()
            case "deep":
                depth = draw(st.sampled_from((50, 5000, 100_000)))
                content = b"<a>" * depth + b"</a>" * draw(st.sampled_from((0, depth)))
            case _:
                damage = draw(st.sampled_from(SPECIAL_FILES))
                target = str(special_path(folder, damage, ".oem")).replace("\0", "\\u0000")
        if not target.isprintable() or "\udcff" in target:
            target = "missing.txt"
        text = f'extends = "inspection"\n[start]\ntarget = "{target}"\n{REMOVED}'
        return Case("orbit message", damage, name, lambda: _load(folder, text, (file, content)))

    return build()


def _omm_xml() -> str:
    fields = {
        "CENTER_NAME": "EARTH",
        "REF_FRAME": "TEME",
        "TIME_SYSTEM": "UTC",
        "MEAN_ELEMENT_THEORY": "SGP4",
        "EPOCH": "2026-03-20T14:46:00.000192",
        "MEAN_MOTION": "15.4956",
        "ECCENTRICITY": "0.0006317",
        "INCLINATION": "51.64",
        "RA_OF_ASC_NODE": "208.9163",
        "ARG_OF_PERICENTER": "69.9862",
        "MEAN_ANOMALY": "25.2906",
        "BSTAR": "0.0001027",
    }
    inner = "".join(f"<{name}>{text}</{name}>" for name, text in fields.items())
    return f"<?xml version='1.0'?>\n<ndm><omm><body><segment>{inner}</segment></body></omm></ndm>"


def _load(folder: Path, text: str, *files: tuple[Path, bytes]) -> None:
    for path, content in files:
        path.write_bytes(content)
    source = folder / "scenario.toml"
    source.write_bytes(text.encode("utf-8", "replace"))
    scenario_loader.load(source)


@st.composite
def _with_value(draw: st.DrawFn, folder: Path) -> Case:
    """A known or nearly known key with a hostile value."""
    base, key = draw(st.sampled_from(NAMES)), draw(st.sampled_from(KEYS))
    damage = draw(st.sampled_from(("value", "value", "value", "misspelt key", "two values", "quoted key")))
    written, value = key, draw(toml_values())
    if damage == "misspelt key":
        at = draw(st.integers(0, len(key) - 1))
        written = key[:at] + key[at + 1 :] or "x"
    elif damage == "quoted key":
        written = '"' + draw(st.sampled_from(TEXTS)) + '"'
    lines = [f'extends = "{base}"', f"{written} = {value}"]
    if damage == "two values":
        lines.append(f"{draw(st.sampled_from(KEYS))} = {draw(toml_values())}")
    text = "\n".join(lines)
    return Case("scenario", damage, key, lambda: _load(folder, text))


@st.composite
def _with_table(draw: st.DrawFn, folder: Path) -> Case:
    """A hostile entry of a list of tables."""
    name = draw(st.sampled_from(sorted(LISTS)))
    keys = draw(st.lists(st.sampled_from(LISTS[name]), min_size=0, max_size=5, unique=True))
    known = {
        "key": st.sampled_from([f'"{key}"' for key in KEYS]),
        "kind": st.sampled_from(['"normal"', '"uniform"', '"choice"', '"log_normal"', '"none"', '"hold"', '"x"']),
        "metric": st.sampled_from(['"min_range_m"', '"delta_v_m_s"', '"nothing"']),
        "bound": st.sampled_from(['"at most"', '"at least"', '"x"']),
    }
    lines = [f"{key} = {draw(st.one_of(known.get(key, toml_values()), toml_values()))}" for key in keys]
    repeated = draw(st.sampled_from((1, 1, 2, 40)))
    base = draw(st.sampled_from(NAMES))
    text = f'extends = "{base}"\n' + "\n".join([f"[[{name}]]", *lines] * repeated)
    return Case("scenario", "table", name, lambda: _load(folder, text))


@st.composite
def _with_structure(draw: st.DrawFn, folder: Path) -> Case:
    """Text whose structure is too deep, too wide or too long; large ones are rare."""
    large = draw(st.integers(0, 300)) == 0
    damage = draw(
        st.sampled_from(("dotted key", "keys", "depth", "tables", "quoted dots", "inline", "comment", "text"))
    )
    size = draw(st.sampled_from((20_000, 300_000))) if large else draw(st.sampled_from((5, 40, 500)))
    texts = {
        "dotted key": lambda: ".".join(["a"] * size) + " = 1",
        "keys": lambda: "\n".join(f"k{n} = 1" for n in range(size)),
        "depth": lambda: "orbit = " + nested(size),
        "tables": lambda: "\n".join(f"[t{n}.u]" for n in range(size)),
        "quoted dots": lambda: '"' + '"."'.join(["."] * size) + '" = 1',
        "inline": lambda: "a = {" + ", ".join(f"k{n} = {{b.c = 1}}" for n in range(size)) + "}",
        "comment": lambda: "\n".join(["# " + "x." * 40] * size),
        "text": lambda: 'name = "' + "=.{," * size + '"',
    }
    return Case("scenario", damage, f"size {size}", lambda: _load(folder, 'extends = "inspection"\n' + texts[damage]()))


@st.composite
def _with_bytes(draw: st.DrawFn, folder: Path) -> Case:
    """A packaged scenario with damaged bytes."""
    name = draw(st.sampled_from(NAMES))
    damage, content = damaged_bytes((PACKAGED / f"{name}.toml").read_bytes(), draw)

    def act() -> None:
        source = folder / "scenario.toml"
        source.write_bytes(content)
        scenario_loader.load(source)

    return Case("scenario", f"bytes: {damage}", name, act)


@st.composite
def _from_path(draw: st.DrawFn, folder: Path) -> Case:
    """A scenario, or the one that it extends, at a path that is no ordinary file."""
    damage = draw(st.sampled_from((*SPECIAL_FILES, "itself", "UTF-16", "circle")))
    suffix = draw(st.sampled_from((".toml", "")))
    place = draw(st.sampled_from(("scenario", "extends")))
    keys = ("imaging.field", "coverage.surface", "plugin", "start.target", "design.file")
    place = draw(st.sampled_from((place, *keys)))

    def act() -> None:
        if damage in ("itself", "circle", "UTF-16"):
            path = folder / "scenario.toml"
            text = 'extends = "scenario.toml"\n' if damage != "UTF-16" else "name = 'x'\n"
            path.write_text(text, encoding="utf-16" if damage == "UTF-16" else "utf-8")
            scenario_loader.load(path)
            return
        path = special_path(folder, damage, suffix)
        if place == "scenario":
            scenario_loader.load(path)
            return
        name = str(path).replace("\0", "\\u0000").encode("utf-8", "replace").decode()
        more = {"imaging.field": 'camera.model = "rendered"\n', "coverage.surface": "coverage.enabled = true\n"}
        more["design.file"] = 'design.kind = "table"\n'
        name += ":setup" if place == "plugin" else ""
        head = "" if place == "extends" else 'extends = "inspection"\n'
        _load(folder, f'{head}{more.get(place, "")}{place} = "{name}"\n')

    return Case("scenario", f"path: {damage}", place, act)
