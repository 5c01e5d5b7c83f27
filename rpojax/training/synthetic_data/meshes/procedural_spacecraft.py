"""Random spacecraft of eleven families, as training data of the detector."""

from collections.abc import Callable

import numpy as np

from rpojax.training.synthetic_data.meshes import mesh_primitives
from rpojax.training.synthetic_data.meshes.mesh_primitives import (
    DARK,
    WHITE,
    Solids,
    nozzle,
    random_antenna,
    random_appendages,
    random_bus,
    random_bus_material,
    random_rod,
    random_solar_cell_material,
    random_truss,
    random_wing,
    random_wings,
)
from rpojax.training.synthetic_data.meshes.packaged_target import FOIL
from rpojax.training.synthetic_data.meshes.target_mesh import Material, TargetMesh

Rng = np.random.Generator
_FAMILY_PROBABILITIES = np.array([0.16, 0.09, 0.11, 0.14, 0.1, 0.08, 0.1, 0.05, 0.06, 0.05, 0.06])


def random_spacecraft(seed: list[int]) -> TargetMesh:
    """Mesh of the spacecraft of a seed."""
    rng = np.random.default_rng(seed)
    family = list(_FAMILIES)[rng.choice(len(_FAMILIES), p=_FAMILY_PROBABILITIES)]
    return mesh_primitives.as_mesh(f"{family} {'-'.join(map(str, seed))}", _FAMILIES[family](rng))


def _smallsat(rng: Rng) -> Solids:
    """A box with wings and appendages."""
    x, y, z = map(float, rng.uniform(0.5, 1.3, 3))
    craft = [random_bus(rng, random_bus_material(rng), x, y, z), *random_appendages(rng, x, y, z)]
    face = mesh_primitives.box(random_bus_material(rng), 0.9 * x, 0.9 * y, 0.01).translated(z=-0.505 * z)
    count = int(rng.choice([1, 2, 2, 2, 4]))
    width = float(rng.uniform(0.6, 1.2)) * x
    return [
        *craft,
        face,
        *random_wings(rng, 0.5 * y, width, int(rng.integers(1, 4)), float(rng.uniform(0.6, 1.2)), count),
    ]


def _prism(rng: Rng) -> Solids:
    """A drum or a six- or eight-sided bus, with cells on its sides or with wings."""
    sections, radius, height = int(rng.choice([6, 8, 28])), float(rng.uniform(0.4, 0.8)), float(rng.uniform(0.4, 1.6))
    craft = [mesh_primitives.frustum(random_bus_material(rng), radius, height, sections=sections)]
    craft += random_appendages(rng, radius, radius, height)
    if rng.random() < 0.4:
        craft += [
            mesh_primitives.frustum(random_solar_cell_material(rng), 1.01 * radius, 0.8 * height, sections=sections)
        ]
    if rng.random() < 0.75:
        count = int(rng.integers(2, 7))
        wings = random_wings(rng, 0.0, float(rng.uniform(0.4, 0.8)), int(rng.integers(1, 3)), 0.9, count)
        craft += mesh_primitives.rotated(
            mesh_primitives.translated(wings, x=float(rng.uniform(-0.3, 0.3)) * height), "y", 90.0
        )
    if rng.random() < 0.4:
        craft += mesh_primitives.translated(nozzle(0.4 * radius), z=-0.5 * height)
    return craft


def _telescope(rng: Rng) -> Solids:
    """A long foiled tube of two diameters, with or without an open lid, two wings and small dishes on booms."""
    radius, length = float(rng.uniform(0.4, 0.7)), float(rng.uniform(2.2, 3.6))
    skin = (
        Material(color=(0.7, 0.68, 0.65), metallic=1.0, roughness=0.3)
        if rng.random() < 0.6
        else random_bus_material(rng)
    )
    craft = [mesh_primitives.crinkled_cylinder(rng, skin, radius, 0.6 * length).translated(z=0.2 * length)]
    craft += [
        mesh_primitives.frustum(
            random_bus_material(rng), radius * float(rng.uniform(1.0, 1.4)), 0.42 * length
        ).translated(z=-0.29 * length)
    ]
    craft += [mesh_primitives.frustum(DARK, 0.9 * radius, 0.01).translated(z=0.503 * length)]
    if rng.random() < 0.6:
        outline = [(radius * np.cos(a), radius * np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 16)[:-1]]
        lid = (
            mesh_primitives.extruded_polygon(WHITE, outline, 0.03)
            .translated(x=radius)
            .rotated("y", float(rng.uniform(-110.0, -30.0)))
        )
        craft += [lid.translated(x=-radius if rng.random() < 0.5 else radius, z=0.5 * length)]
    for ring in rng.uniform(-0.45, 0.45, int(rng.integers(0, 5))):
        craft += [
            mesh_primitives.frustum(random_bus_material(rng), 1.03 * radius, 0.03 * length).translated(
                z=float(ring) * length
            )
        ]
    wings = random_wings(rng, 1.1 * radius, float(rng.uniform(0.6, 1.1)), 1, float(rng.uniform(1.0, 2.0)))
    craft += mesh_primitives.rotated(wings, "y", 90.0)
    for side in (0.0, 180.0):
        if rng.random() < 0.6:
            boom = [*random_rod(rng, 1.3), *mesh_primitives.translated(random_antenna(rng, 0.2), z=1.3)]
            craft += mesh_primitives.rotated(
                mesh_primitives.rotated(boom, "y", 90.0 + float(rng.normal(scale=20.0))), "z", side
            )
    return craft


def _station(rng: Rng) -> Solids:
    """A truss with pairs of long wings at its ends, modules across its centre, and radiators."""
    length, side = float(rng.uniform(5.0, 9.0)), float(rng.uniform(0.25, 0.45))
    craft = random_truss(rng, random_bus_material(rng), length, side)
    cells, frame = random_solar_cell_material(rng), random_bus_material(rng)
    width, wing = float(rng.uniform(0.35, 0.7)), float(rng.uniform(2.0, 3.6))
    tilt = float(rng.uniform(-90.0, 90.0)) if rng.random() < 0.5 else float(rng.normal(scale=15.0))
    for x in np.linspace(0.3, 0.5, int(rng.integers(1, 4))) * length:
        for place in (-x, x):
            for up in (0.0, 180.0):
                pair = [random_wing(rng, cells, frame, width, [wing], side).copy() for _ in range(2)]
                blades = [
                    *mesh_primitives.translated(pair[0], x=-0.56 * width),
                    *mesh_primitives.translated(pair[1], x=0.56 * width),
                ]
                craft += mesh_primitives.translated(
                    mesh_primitives.rotated(mesh_primitives.rotated(blades, "y", tilt), "x", up), x=float(place)
                )
    for _ in range(int(rng.integers(2, 7))):
        radius, long = float(rng.uniform(0.2, 0.35)), float(rng.uniform(0.8, 2.0))
        module = mesh_primitives.frustum(WHITE if rng.random() < 0.6 else random_bus_material(rng), radius, long)
        axis = str(rng.choice(["x", "y", "z"]))
        piece = [module] if axis == "z" else [module.rotated("y" if axis == "x" else "x", 90.0)]
        shift = rng.uniform(-0.9, 0.9, 3) * [0.8, 1.2, 1.2]
        craft += mesh_primitives.translated(piece, *map(float, shift))
    for place in rng.uniform(-0.25, 0.25, int(rng.integers(0, 5))):
        radiator = mesh_primitives.box(WHITE, 0.5, 1.4, 0.02).rotated("x", float(rng.uniform(0.0, 180.0)))
        craft += [radiator.translated(x=float(place) * length, y=0.7)]
    return craft


def _shuttle(rng: Rng) -> Solids:
    """A winged body with a fin, dark below, its bay open or shut."""
    skin, belly = random_bus_material(rng) if rng.random() < 0.3 else WHITE, DARK
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
        craft += mesh_primitives.translated(nozzle(0.2), x, y, -0.5 * length)
    if rng.random() < 0.5:
        bay = mesh_primitives.box(random_bus_material(rng), 0.1, 0.6, 0.6 * length).translated(x=0.47)
        doors = [
            mesh_primitives.box(WHITE, 0.04, 0.5, 0.6 * length).translated(0.35, side * 0.75) for side in (-1.0, 1.0)
        ]
        craft += [bay, *doors]
    return craft


def _capsule(rng: Rng) -> Solids:
    """A cone or ball on a service module, with wings or without."""
    radius = float(rng.uniform(0.5, 0.8))
    skin = random_bus_material(rng)
    service = float(rng.uniform(0.6, 1.8))
    craft = [mesh_primitives.frustum(random_bus_material(rng), radius, service).translated(z=-0.5 * service)]
    craft += [mesh_primitives.frustum(skin, radius, 0.9, float(rng.uniform(0.2, 0.6)) * radius).translated(z=0.45)]
    if rng.random() < 0.4:
        arc = np.linspace(-np.pi / 2.0, np.pi / 2.0, 9)
        ball = mesh_primitives.surface_of_revolution(
            skin, [(0.75 * radius * np.cos(a), 0.75 * radius * np.sin(a)) for a in arc]
        )
        craft += [ball.translated(z=1.3)]
    craft += mesh_primitives.translated(nozzle(0.5 * radius), z=-service)
    if rng.random() < 0.8:
        count, panels = int(rng.choice([2, 2, 3, 4])), int(rng.integers(1, 5))
        wings = random_wings(rng, radius, float(rng.uniform(0.5, 0.8)), panels, float(rng.uniform(0.5, 0.8)), count)
        craft += mesh_primitives.translated(mesh_primitives.rotated(wings, "y", 90.0), z=-0.6 * service)
    return craft


def _comsat(rng: Rng) -> Solids:
    """A bus with two long wings of many panels, and large dishes."""
    x, y, z = map(float, rng.uniform(0.7, 1.2, 3))
    craft = [random_bus(rng, random_bus_material(rng), x, y, z), *random_appendages(rng, x, y, z)]
    craft += random_wings(
        rng, 0.5 * y, float(rng.uniform(0.6, 1.0)), int(rng.integers(2, 6)), float(rng.uniform(0.6, 1.1))
    )
    for side in (-1.0, 1.0):
        if rng.random() < 0.7:
            antenna = mesh_primitives.rotated(
                random_antenna(rng, float(rng.uniform(0.4, 0.8))), "y", side * float(rng.uniform(10, 60))
            )
            craft += mesh_primitives.translated(antenna, x=side * 0.9 * x, z=0.3 * z)
    return craft


def _rocket_stage(rng: Rng) -> Solids:
    """A spent stage: a tube with rings, a cone and an engine."""
    radius, length = float(rng.uniform(0.4, 0.7)), float(rng.uniform(1.2, 4.0))
    craft = [mesh_primitives.frustum(random_bus_material(rng), radius, length)]
    for ring in rng.uniform(-0.5, 0.5, int(rng.integers(1, 5))):
        craft += [
            mesh_primitives.frustum(random_bus_material(rng), 1.02 * radius, 0.05 * length).translated(
                z=float(ring) * length
            )
        ]
    taper = mesh_primitives.frustum(
        random_bus_material(rng), radius, 0.4 * radius, float(rng.uniform(0.3, 0.8)) * radius
    )
    craft += [taper.translated(z=0.5 * length + 0.2 * radius)]
    return [*craft, *mesh_primitives.translated(nozzle(float(rng.uniform(0.3, 0.9)) * radius), z=-0.5 * length)]


def _cubesat(rng: Rng) -> Solids:
    """A small box of units, bare or with cells on it, flaps and rods."""
    x, y, z = sorted(float(0.1 * n) for n in rng.choice([1, 1, 2, 2, 3, 6], 3))
    cells = random_solar_cell_material(rng)
    craft = [
        mesh_primitives.box(random_bus_material(rng), x, y, z),
        mesh_primitives.box(cells, 1.01 * x, 0.85 * y, 0.85 * z),
    ]
    craft += [mesh_primitives.box(cells, 0.85 * x, 1.01 * y, 0.85 * z)]
    if rng.random() < 0.7:
        craft += mesh_primitives.rotated(random_wings(rng, 0.5 * y, z, int(rng.integers(1, 4)), y), "y", 90.0)
    for _ in range(int(rng.integers(0, 5))):
        craft += mesh_primitives.rotated(random_rod(rng, 1.5 * z), "x", float(rng.uniform(0.0, 360.0)))
    return craft


def _probe(rng: Rng) -> Solids:
    """A body behind one large dish, with booms."""
    size = float(rng.uniform(0.8, 1.4))
    craft = [
        *random_antenna(rng, size),
        mesh_primitives.frustum(FOIL, 0.5 * size, 0.6 * size, sections=8).translated(z=-0.3 * size),
    ]
    for _ in range(int(rng.integers(1, 4))):
        boom = random_rod(rng, float(rng.uniform(1.0, 3.0)) * size)
        craft += mesh_primitives.rotated(mesh_primitives.rotated(boom, "y", 90.0), "z", float(rng.uniform(0.0, 360.0)))
    if rng.random() < 0.5:
        craft += mesh_primitives.rotated(random_wings(rng, 0.5 * size, 0.6 * size, 2, 0.9 * size), "y", 90.0)
    return craft


def _modular_station(rng: Rng) -> Solids:
    """Modules end to end and across, each with wings of its own."""
    craft: Solids = []
    at = 0.0
    for _ in range(int(rng.integers(2, 5))):
        radius, length = float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.8, 2.0))
        craft += [mesh_primitives.frustum(random_bus_material(rng), radius, length).translated(z=at + 0.5 * length)]
        craft += [mesh_primitives.frustum(random_bus_material(rng), 0.7 * radius, 0.15).translated(z=at + length)]
        if rng.random() < 0.7:
            wings = mesh_primitives.rotated(random_wings(rng, radius, 0.5, int(rng.integers(2, 5)), 0.7), "y", 90.0)
            wings = mesh_primitives.rotated(wings, "z", 90.0 * int(rng.integers(2)))
            craft += mesh_primitives.translated(wings, z=at + 0.5 * length)
        if rng.random() < 0.4:
            across = mesh_primitives.frustum(random_bus_material(rng), 0.8 * radius, 1.4).rotated("x", 90.0)
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
