"""Spacecraft that nobody built: meshes of a dozen families, drawn at random, for a detector to learn what is common."""

from collections.abc import Callable

import numpy as np

from rpojax.training.synthetic_data import mesh_primitives
from rpojax.training.synthetic_data.mesh_primitives import Solids
from rpojax.training.synthetic_data.target_mesh import FOIL, Material, TargetMesh

Rng = np.random.Generator

_WHITE = Material(color=(0.8, 0.8, 0.78), roughness=0.6)
_DARK = Material(color=(0.04, 0.04, 0.045), roughness=0.6)


def random_spacecraft(seed: list[int]) -> TargetMesh:
    """The spacecraft of a seed."""
    rng = np.random.default_rng(seed)
    family = list(_FAMILIES)[rng.choice(len(_FAMILIES), p=_FAMILY_PROBABILITIES)]
    return mesh_primitives.as_mesh(f"{family} {'-'.join(map(str, seed))}", _FAMILIES[family](rng))


def _bus_material(rng: Rng) -> Material:
    """A surface of a bus: paint, foil or bare metal."""
    kind = rng.choice(["white", "grey", "gold", "silver", "dark", "tint"], p=[0.3, 0.18, 0.16, 0.16, 0.1, 0.1])
    tone = float(rng.uniform(0.85, 1.1))
    if kind == "gold":
        red, green, blue = (tone * c for c in rng.uniform([0.6, 0.35, 0.08], [0.85, 0.6, 0.25]))
        return Material(color=(min(red, 0.95), green, blue), metallic=1.0, roughness=float(rng.uniform(0.2, 0.45)))
    if kind == "silver":
        grey = float(rng.uniform(0.45, 0.85))
        return Material(color=(grey, grey, grey), metallic=1.0, roughness=float(rng.uniform(0.2, 0.5)))
    low, high = {"white": (0.6, 0.85), "grey": (0.15, 0.5), "dark": (0.02, 0.08), "tint": (0.1, 0.6)}[str(kind)]
    base = np.full(3, rng.uniform(low, high)) * (rng.uniform(0.4, 1.0, 3) if kind == "tint" else 1.0)
    red, green, blue = (float(c) for c in base)
    return Material(color=(red, green, blue), roughness=float(rng.uniform(0.3, 0.9)))


def _solar_cell_material(rng: Rng) -> Material:
    """The lit side of a panel: blue, black, or the copper and tan of a blanket."""
    kind = rng.choice(["blue", "black", "copper"], p=[0.5, 0.25, 0.25])
    low, high = {
        "blue": ([0.01, 0.02, 0.06], [0.06, 0.1, 0.3]),
        "black": ([0.01, 0.01, 0.012], [0.05, 0.05, 0.06]),
        "copper": ([0.3, 0.14, 0.04], [0.7, 0.42, 0.2]),
    }[str(kind)]
    red, green, blue = (float(c) for c in rng.uniform(low, high))
    return Material(color=(red, green, blue), roughness=float(rng.uniform(0.15, 0.5)))


def _bus(rng: Rng, material: Material, x: float, y: float, z: float) -> mesh_primitives.Solid:
    foil = material.metallic > 0.5 and rng.random() < 0.8
    return mesh_primitives.crinkled_box(rng, material, x, y, z) if foil else mesh_primitives.box(material, x, y, z)


def _panel(rng: Rng, cells: Material, frame: Material, width: float, length: float) -> Solids:
    """A panel in the x-y plane, from y = 0 on, with rows of cells on its +z side."""
    craft = [mesh_primitives.box(frame, width, length, 0.015 * max(width, 0.3)).translated(y=0.5 * length)]
    across, along = int(rng.integers(1, 6)), int(np.clip(round(length / width * rng.integers(2, 6)), 2, 24))
    gap = float(rng.uniform(0.85, 0.97))
    for column in range(across):
        for row in range(along):
            size = (width / across * gap, length / along * gap, 0.004)
            place = ((column + 0.5) / across - 0.5) * width, (row + 0.5) / along * length
            craft.append(mesh_primitives.box(cells, *size).translated(*place, 0.012 * max(width, 0.3)))
    return craft


def _wing(rng: Rng, cells: Material, frame: Material, width: float, lengths: list[float], boom: float) -> Solids:
    """A wing along +y: a boom, then panels one after the other."""
    craft = (
        [mesh_primitives.box(frame, 0.06 * width, boom, 0.06 * width).translated(y=0.5 * boom)] if boom > 0.0 else []
    )
    at = boom
    for length in lengths:
        craft += mesh_primitives.translated(_panel(rng, cells, frame, width, length), y=at)
        at += length * 1.03
    return craft


def _wings(rng: Rng, half_m: float, width: float, panels: int, length: float, count: int = 2) -> Solids:
    """Like wings evenly round the x axis, turned about their booms alike."""
    cells, frame = _solar_cell_material(rng), _bus_material(rng)
    wing = _wing(rng, cells, frame, width, [length] * panels, float(rng.uniform(0.05, 0.4)) * width)
    wing = mesh_primitives.translated(mesh_primitives.rotated(wing, "y", float(rng.uniform(-90.0, 90.0))), y=half_m)
    return [solid for i in range(count) for solid in mesh_primitives.rotated(wing, "x", 360.0 * i / count)]


def _antenna(rng: Rng, size: float) -> Solids:
    """A dish with its feed, open to +z."""
    material = _WHITE if rng.random() < 0.6 else _bus_material(rng)
    feed = mesh_primitives.frustum(_DARK, 0.06 * size, 0.5 * size).translated(z=0.3 * size)
    return [mesh_primitives.paraboloid(material, size, float(rng.uniform(0.2, 0.5)) * size), feed]


def _rod(rng: Rng, length: float) -> Solids:
    """A thin boom along +z."""
    return [mesh_primitives.frustum(_bus_material(rng), 0.012 * length, length, sections=6).translated(z=0.5 * length)]


def _nozzle(radius: float) -> Solids:
    """An engine bell open to -z."""
    return [
        mesh_primitives.surface_of_revolution(
            _DARK, [(0.35 * radius, 0.0), (0.6 * radius, -0.6 * radius), (radius, -1.5 * radius)]
        )
    ]


def _appendages(rng: Rng, x: float, y: float, z: float) -> Solids:
    """What sticks out of a bus of that size: boxes, dishes, rods, baffles."""
    craft: Solids = []
    scale = (x * y * z) ** (1.0 / 3.0)
    for _ in range(int(rng.integers(1, 7))):
        kind = rng.choice(["box", "dish", "rod", "baffle"], p=[0.4, 0.2, 0.2, 0.2])
        if kind == "box":
            sides = scale * rng.uniform(0.08, 0.4, 3)
            piece = [mesh_primitives.box(_bus_material(rng), *map(float, sides))]
        elif kind == "dish":
            piece = mesh_primitives.translated(_antenna(rng, scale * float(rng.uniform(0.15, 0.5))), z=0.05 * scale)
        elif kind == "rod":
            piece = _rod(rng, scale * float(rng.uniform(0.4, 1.6)))
        else:
            piece = [mesh_primitives.frustum(_DARK, 0.1 * scale, 0.3 * scale, 0.15 * scale).translated(z=0.1 * scale)]
        spot = rng.uniform(-0.35, 0.35, 2)
        piece = mesh_primitives.translated(piece, float(spot[0]) * x, float(spot[1]) * y, 0.5 * z)
        craft += mesh_primitives.rotated(piece, "x", 90.0 * int(rng.integers(4))) if abs(y - z) < 0.3 * z else piece
    return craft


def _smallsat(rng: Rng) -> Solids:
    x, y, z = map(float, rng.uniform(0.5, 1.3, 3))
    craft = [_bus(rng, _bus_material(rng), x, y, z), *_appendages(rng, x, y, z)]
    face = mesh_primitives.box(_bus_material(rng), 0.9 * x, 0.9 * y, 0.01).translated(z=-0.505 * z)
    count = int(rng.choice([1, 2, 2, 2, 4]))
    width = float(rng.uniform(0.6, 1.2)) * x
    return [*craft, face, *_wings(rng, 0.5 * y, width, int(rng.integers(1, 4)), float(rng.uniform(0.6, 1.2)), count)]


def _prism(rng: Rng) -> Solids:
    """A drum or a six- or eight-sided bus, with cells on its sides or with wings."""
    sections, radius, height = int(rng.choice([6, 8, 28])), float(rng.uniform(0.4, 0.8)), float(rng.uniform(0.4, 1.6))
    craft = [mesh_primitives.frustum(_bus_material(rng), radius, height, sections=sections)]
    craft += _appendages(rng, radius, radius, height)
    if rng.random() < 0.4:
        craft += [mesh_primitives.frustum(_solar_cell_material(rng), 1.01 * radius, 0.8 * height, sections=sections)]
    if rng.random() < 0.75:
        count = int(rng.integers(2, 7))
        wings = _wings(rng, 0.0, float(rng.uniform(0.4, 0.8)), int(rng.integers(1, 3)), 0.9, count)
        craft += mesh_primitives.rotated(
            mesh_primitives.translated(wings, x=float(rng.uniform(-0.3, 0.3)) * height), "y", 90.0
        )
    if rng.random() < 0.4:
        craft += mesh_primitives.translated(_nozzle(0.4 * radius), z=-0.5 * height)
    return craft


def _telescope(rng: Rng) -> Solids:
    """A long foiled tube of two diameters, with or without an open lid, two wings and small dishes on booms."""
    radius, length = float(rng.uniform(0.4, 0.7)), float(rng.uniform(2.2, 3.6))
    skin = Material(color=(0.7, 0.68, 0.65), metallic=1.0, roughness=0.3) if rng.random() < 0.6 else _bus_material(rng)
    craft = [mesh_primitives.crinkled_cylinder(rng, skin, radius, 0.6 * length).translated(z=0.2 * length)]
    craft += [
        mesh_primitives.frustum(_bus_material(rng), radius * float(rng.uniform(1.0, 1.4)), 0.42 * length).translated(
            z=-0.29 * length
        )
    ]
    craft += [mesh_primitives.frustum(_DARK, 0.9 * radius, 0.01).translated(z=0.503 * length)]
    if rng.random() < 0.6:
        outline = [(radius * np.cos(a), radius * np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 16)[:-1]]
        lid = (
            mesh_primitives.extruded_polygon(_WHITE, outline, 0.03)
            .translated(x=radius)
            .rotated("y", float(rng.uniform(-110.0, -30.0)))
        )
        craft += [lid.translated(x=-radius if rng.random() < 0.5 else radius, z=0.5 * length)]
    for ring in rng.uniform(-0.45, 0.45, int(rng.integers(0, 5))):
        craft += [
            mesh_primitives.frustum(_bus_material(rng), 1.03 * radius, 0.03 * length).translated(z=float(ring) * length)
        ]
    wings = _wings(rng, 1.1 * radius, float(rng.uniform(0.6, 1.1)), 1, float(rng.uniform(1.0, 2.0)))
    craft += mesh_primitives.rotated(wings, "y", 90.0)
    for side in (0.0, 180.0):
        if rng.random() < 0.6:
            boom = [*_rod(rng, 1.3), *mesh_primitives.translated(_antenna(rng, 0.2), z=1.3)]
            craft += mesh_primitives.rotated(
                mesh_primitives.rotated(boom, "y", 90.0 + float(rng.normal(scale=20.0))), "z", side
            )
    return craft


def _truss(rng: Rng, material: Material, length: float, side: float) -> Solids:
    """A lattice beam along x."""
    bar = 0.12 * side
    craft = [
        mesh_primitives.box(material, length, bar, bar).translated(y=y, z=z)
        for y in (-0.5 * side, 0.5 * side)
        for z in (-0.5 * side, 0.5 * side)
    ]
    bays = max(2, int(length / side))
    for bay in range(bays + 1):
        x = (bay / bays - 0.5) * length
        frame = [mesh_primitives.box(material, bar, side, bar).translated(z=z) for z in (-0.5 * side, 0.5 * side)]
        frame += [mesh_primitives.box(material, bar, bar, side).translated(y=y) for y in (-0.5 * side, 0.5 * side)]
        frame += [mesh_primitives.box(material, bar, bar, 1.35 * side).rotated("x", 45.0)]
        craft += mesh_primitives.translated(frame, x)
    if rng.random() < 0.7:
        craft += [mesh_primitives.box(_bus_material(rng), 0.9 * length, 0.7 * side, 0.7 * side)]
    return craft


def _station(rng: Rng) -> Solids:
    """A truss with pairs of long wings at its ends, modules across its middle, and radiators."""
    length, side = float(rng.uniform(5.0, 9.0)), float(rng.uniform(0.25, 0.45))
    craft = _truss(rng, _bus_material(rng), length, side)
    cells, frame = _solar_cell_material(rng), _bus_material(rng)
    width, wing = float(rng.uniform(0.35, 0.7)), float(rng.uniform(2.0, 3.6))
    tilt = float(rng.uniform(-90.0, 90.0)) if rng.random() < 0.5 else float(rng.normal(scale=15.0))
    for x in np.linspace(0.3, 0.5, int(rng.integers(1, 4))) * length:
        for place in (-x, x):
            for up in (0.0, 180.0):
                pair = [_wing(rng, cells, frame, width, [wing], side).copy() for _ in range(2)]
                blades = [
                    *mesh_primitives.translated(pair[0], x=-0.56 * width),
                    *mesh_primitives.translated(pair[1], x=0.56 * width),
                ]
                craft += mesh_primitives.translated(
                    mesh_primitives.rotated(mesh_primitives.rotated(blades, "y", tilt), "x", up), x=float(place)
                )
    for _ in range(int(rng.integers(2, 7))):
        radius, long = float(rng.uniform(0.2, 0.35)), float(rng.uniform(0.8, 2.0))
        module = mesh_primitives.frustum(_WHITE if rng.random() < 0.6 else _bus_material(rng), radius, long)
        axis = str(rng.choice(["x", "y", "z"]))
        piece = [module] if axis == "z" else [module.rotated("y" if axis == "x" else "x", 90.0)]
        shift = rng.uniform(-0.9, 0.9, 3) * [0.8, 1.2, 1.2]
        craft += mesh_primitives.translated(piece, *map(float, shift))
    for place in rng.uniform(-0.25, 0.25, int(rng.integers(0, 5))):
        radiator = mesh_primitives.box(_WHITE, 0.5, 1.4, 0.02).rotated("x", float(rng.uniform(0.0, 180.0)))
        craft += [radiator.translated(x=float(place) * length, y=0.7)]
    return craft


def _shuttle(rng: Rng) -> Solids:
    """A winged body with a fin, dark below, its bay open or shut."""
    skin, belly = _bus_material(rng) if rng.random() < 0.3 else _WHITE, _DARK
    radius, length = 0.5, float(rng.uniform(3.0, 4.2))
    nose = mesh_primitives.surface_of_revolution(
        skin, [(radius, 0.0), (0.9 * radius, 0.5), (0.5 * radius, 0.9), (0.0, 1.05)]
    )
    craft = [mesh_primitives.frustum(skin, radius, length), nose.translated(z=0.5 * length)]
    craft += [mesh_primitives.box(belly, 0.1, 0.9, 0.95 * length).translated(x=-0.42)]
    span, root = float(rng.uniform(1.2, 1.9)), float(rng.uniform(0.55, 0.8)) * length
    tip = float(rng.uniform(0.15, 0.4)) * root
    for side in (-1.0, 1.0):
        outline = [(0.0, 0.0), (side * span, 0.05), (side * span, tip), (side * 0.6, 0.55 * root), (0.0, root)]
        for material, height in ((skin, -0.36), (belly, -0.41)):
            wing = mesh_primitives.extruded_polygon(material, outline, 0.05).rotated("x", 90.0).rotated("z", 90.0)
            craft += [wing.translated(x=height, z=-0.5 * length)]
    fin = mesh_primitives.extruded_polygon(skin, [(0.0, 0.0), (1.4, -0.3), (1.4, 0.3), (0.0, 1.1)], 0.06).rotated(
        "x", 90.0
    )
    craft += [fin.translated(x=0.4, z=-0.48 * length)]
    for y, x in ((-0.22, 0.0), (0.22, 0.0), (0.0, 0.3)):
        craft += mesh_primitives.translated(_nozzle(0.2), x, y, -0.5 * length)
    if rng.random() < 0.5:
        bay = mesh_primitives.box(_bus_material(rng), 0.1, 0.6, 0.6 * length).translated(x=0.47)
        doors = [
            mesh_primitives.box(_WHITE, 0.04, 0.5, 0.6 * length).translated(0.35, side * 0.75) for side in (-1.0, 1.0)
        ]
        craft += [bay, *doors]
    return craft


def _capsule(rng: Rng) -> Solids:
    """A cone or ball on a service module, with wings or without."""
    radius = float(rng.uniform(0.5, 0.8))
    skin = _bus_material(rng)
    service = float(rng.uniform(0.6, 1.8))
    craft = [mesh_primitives.frustum(_bus_material(rng), radius, service).translated(z=-0.5 * service)]
    craft += [mesh_primitives.frustum(skin, radius, 0.9, float(rng.uniform(0.2, 0.6)) * radius).translated(z=0.45)]
    if rng.random() < 0.4:
        arc = np.linspace(-np.pi / 2.0, np.pi / 2.0, 9)
        ball = mesh_primitives.surface_of_revolution(
            skin, [(0.75 * radius * np.cos(a), 0.75 * radius * np.sin(a)) for a in arc]
        )
        craft += [ball.translated(z=1.3)]
    craft += mesh_primitives.translated(_nozzle(0.5 * radius), z=-service)
    if rng.random() < 0.8:
        count, panels = int(rng.choice([2, 2, 3, 4])), int(rng.integers(1, 5))
        wings = _wings(rng, radius, float(rng.uniform(0.5, 0.8)), panels, float(rng.uniform(0.5, 0.8)), count)
        craft += mesh_primitives.translated(mesh_primitives.rotated(wings, "y", 90.0), z=-0.6 * service)
    return craft


def _comsat(rng: Rng) -> Solids:
    """A bus with two long wings of many panels, and large dishes."""
    x, y, z = map(float, rng.uniform(0.7, 1.2, 3))
    craft = [_bus(rng, _bus_material(rng), x, y, z), *_appendages(rng, x, y, z)]
    craft += _wings(rng, 0.5 * y, float(rng.uniform(0.6, 1.0)), int(rng.integers(2, 6)), float(rng.uniform(0.6, 1.1)))
    for side in (-1.0, 1.0):
        if rng.random() < 0.7:
            antenna = mesh_primitives.rotated(
                _antenna(rng, float(rng.uniform(0.4, 0.8))), "y", side * float(rng.uniform(10, 60))
            )
            craft += mesh_primitives.translated(antenna, x=side * 0.9 * x, z=0.3 * z)
    return craft


def _rocket_stage(rng: Rng) -> Solids:
    """A spent stage: a tube with rings, a cone and an engine."""
    radius, length = float(rng.uniform(0.4, 0.7)), float(rng.uniform(1.2, 4.0))
    craft = [mesh_primitives.frustum(_bus_material(rng), radius, length)]
    for ring in rng.uniform(-0.5, 0.5, int(rng.integers(1, 5))):
        craft += [
            mesh_primitives.frustum(_bus_material(rng), 1.02 * radius, 0.05 * length).translated(z=float(ring) * length)
        ]
    taper = mesh_primitives.frustum(_bus_material(rng), radius, 0.4 * radius, float(rng.uniform(0.3, 0.8)) * radius)
    craft += [taper.translated(z=0.5 * length + 0.2 * radius)]
    return [*craft, *mesh_primitives.translated(_nozzle(float(rng.uniform(0.3, 0.9)) * radius), z=-0.5 * length)]


def _cubesat(rng: Rng) -> Solids:
    """A small box of units, bare or with cells on it, flaps and rods."""
    x, y, z = sorted(float(0.1 * n) for n in rng.choice([1, 1, 2, 2, 3, 6], 3))
    cells = _solar_cell_material(rng)
    craft = [mesh_primitives.box(_bus_material(rng), x, y, z), mesh_primitives.box(cells, 1.01 * x, 0.85 * y, 0.85 * z)]
    craft += [mesh_primitives.box(cells, 0.85 * x, 1.01 * y, 0.85 * z)]
    if rng.random() < 0.7:
        craft += mesh_primitives.rotated(_wings(rng, 0.5 * y, z, int(rng.integers(1, 4)), y), "y", 90.0)
    for _ in range(int(rng.integers(0, 5))):
        craft += mesh_primitives.rotated(_rod(rng, 1.5 * z), "x", float(rng.uniform(0.0, 360.0)))
    return craft


def _probe(rng: Rng) -> Solids:
    """A body behind one large dish, with booms."""
    size = float(rng.uniform(0.8, 1.4))
    craft = [
        *_antenna(rng, size),
        mesh_primitives.frustum(FOIL, 0.5 * size, 0.6 * size, sections=8).translated(z=-0.3 * size),
    ]
    for _ in range(int(rng.integers(1, 4))):
        boom = _rod(rng, float(rng.uniform(1.0, 3.0)) * size)
        craft += mesh_primitives.rotated(mesh_primitives.rotated(boom, "y", 90.0), "z", float(rng.uniform(0.0, 360.0)))
    if rng.random() < 0.5:
        craft += mesh_primitives.rotated(_wings(rng, 0.5 * size, 0.6 * size, 2, 0.9 * size), "y", 90.0)
    return craft


def _modular_station(rng: Rng) -> Solids:
    """Modules end to end and across, each with wings of its own."""
    craft: Solids = []
    at = 0.0
    for _ in range(int(rng.integers(2, 5))):
        radius, length = float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.8, 2.0))
        craft += [mesh_primitives.frustum(_bus_material(rng), radius, length).translated(z=at + 0.5 * length)]
        craft += [mesh_primitives.frustum(_bus_material(rng), 0.7 * radius, 0.15).translated(z=at + length)]
        if rng.random() < 0.7:
            wings = mesh_primitives.rotated(_wings(rng, radius, 0.5, int(rng.integers(2, 5)), 0.7), "y", 90.0)
            wings = mesh_primitives.rotated(wings, "z", 90.0 * int(rng.integers(2)))
            craft += mesh_primitives.translated(wings, z=at + 0.5 * length)
        if rng.random() < 0.4:
            across = mesh_primitives.frustum(_bus_material(rng), 0.8 * radius, 1.4).rotated("x", 90.0)
            craft += [across.translated(y=1.1, z=at + 0.5 * length)]
        at += length + 0.1
    return craft


_FAMILIES: dict[str, Callable[[Rng], Solids]] = {
    "smallsat": _smallsat,
    "prism": _prism,
    "telescope": _telescope,
    "station": _station,
    "shuttle": _shuttle,
    "capsule": _capsule,
    "comsat": _comsat,
    "stage": _rocket_stage,
    "cubesat": _cubesat,
    "probe": _probe,
    "laboratory": _modular_station,
}
_FAMILY_PROBABILITIES = np.array([0.16, 0.09, 0.11, 0.14, 0.1, 0.08, 0.1, 0.05, 0.06, 0.05, 0.06])
