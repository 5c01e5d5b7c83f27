"""Random parts of procedural spacecraft: materials, buses, wings, antennas, booms, engines, trusses."""

import numpy as np

from rpojax.training.synthetic_data.meshes import mesh_primitives
from rpojax.training.synthetic_data.meshes.mesh_primitives import Solids
from rpojax.training.synthetic_data.meshes.target_mesh import Material

Rng = np.random.Generator

WHITE = Material(color=(0.8, 0.8, 0.78), roughness=0.6)
DARK = Material(color=(0.04, 0.04, 0.045), roughness=0.6)


def random_bus_material(rng: Rng) -> Material:
    """Random surface of a bus: paint, foil or bare metal."""
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


def random_solar_cell_material(rng: Rng) -> Material:
    """Random front of a solar panel: blue, black, or copper and tan as of a blanket."""
    kind = rng.choice(["blue", "black", "copper"], p=[0.5, 0.25, 0.25])
    low, high = {
        "blue": ([0.01, 0.02, 0.06], [0.06, 0.1, 0.3]),
        "black": ([0.01, 0.01, 0.012], [0.05, 0.05, 0.06]),
        "copper": ([0.3, 0.14, 0.04], [0.7, 0.42, 0.2]),
    }[str(kind)]
    red, green, blue = (float(c) for c in rng.uniform(low, high))
    return Material(color=(red, green, blue), roughness=float(rng.uniform(0.15, 0.5)))


def random_bus(rng: Rng, material: Material, x: float, y: float, z: float) -> mesh_primitives.Solid:
    """A bus of a size [m], mostly crinkled if it is of metal."""
    foil = material.metallic > 0.5 and rng.random() < 0.8
    return mesh_primitives.crinkled_box(rng, material, x, y, z) if foil else mesh_primitives.box(material, x, y, z)


def _panel(rng: Rng, cells: Material, frame: Material, width: float, length: float) -> Solids:
    """A panel in the x-y plane, from y = 0 on, with rows of cells on its +z side."""
    solids = [mesh_primitives.box(frame, width, length, 0.015 * max(width, 0.3)).translated(y=0.5 * length)]
    across, along = int(rng.integers(1, 6)), int(np.clip(round(length / width * rng.integers(2, 6)), 2, 24))
    gap = float(rng.uniform(0.85, 0.97))
    for column in range(across):
        for row in range(along):
            size = (width / across * gap, length / along * gap, 0.004)
            place = ((column + 0.5) / across - 0.5) * width, (row + 0.5) / along * length
            solids.append(mesh_primitives.box(cells, *size).translated(*place, 0.012 * max(width, 0.3)))
    return solids


def random_wing(rng: Rng, cells: Material, frame: Material, width: float, lengths: list[float], boom: float) -> Solids:
    """A wing along +y: a boom, then panels one after the other."""
    solids = (
        [mesh_primitives.box(frame, 0.06 * width, boom, 0.06 * width).translated(y=0.5 * boom)] if boom > 0.0 else []
    )
    at = boom
    for length in lengths:
        solids += mesh_primitives.translated(_panel(rng, cells, frame, width, length), y=at)
        at += length * 1.03
    return solids


def random_wings(rng: Rng, half_m: float, width: float, panels: int, length: float, count: int = 2) -> Solids:
    """Equal wings evenly spaced round the x axis, rotated alike about their booms."""
    cells, frame = random_solar_cell_material(rng), random_bus_material(rng)
    wing = random_wing(rng, cells, frame, width, [length] * panels, float(rng.uniform(0.05, 0.4)) * width)
    wing = mesh_primitives.translated(mesh_primitives.rotated(wing, "y", float(rng.uniform(-90.0, 90.0))), y=half_m)
    return [solid for i in range(count) for solid in mesh_primitives.rotated(wing, "x", 360.0 * i / count)]


def random_antenna(rng: Rng, size: float) -> Solids:
    """A dish with its feed, open to +z."""
    material = WHITE if rng.random() < 0.6 else random_bus_material(rng)
    feed = mesh_primitives.frustum(DARK, 0.06 * size, 0.5 * size).translated(z=0.3 * size)
    return [mesh_primitives.paraboloid(material, size, float(rng.uniform(0.2, 0.5)) * size), feed]


def random_rod(rng: Rng, length: float) -> Solids:
    """A thin boom along +z."""
    return [
        mesh_primitives.frustum(random_bus_material(rng), 0.012 * length, length, sections=6).translated(z=0.5 * length)
    ]


def nozzle(radius: float) -> Solids:
    """An engine bell open to -z."""
    return [
        mesh_primitives.surface_of_revolution(
            DARK, [(0.35 * radius, 0.0), (0.6 * radius, -0.6 * radius), (radius, -1.5 * radius)]
        )
    ]


def random_appendages(rng: Rng, x: float, y: float, z: float) -> Solids:
    """Random appendages of a bus of a size [m]: boxes, dishes, rods, baffles."""
    solids: Solids = []
    scale = (x * y * z) ** (1.0 / 3.0)
    for _ in range(int(rng.integers(1, 7))):
        kind = rng.choice(["box", "dish", "rod", "baffle"], p=[0.4, 0.2, 0.2, 0.2])
        if kind == "box":
            sides = scale * rng.uniform(0.08, 0.4, 3)
            piece = [mesh_primitives.box(random_bus_material(rng), *map(float, sides))]
        elif kind == "dish":
            piece = mesh_primitives.translated(
                random_antenna(rng, scale * float(rng.uniform(0.15, 0.5))), z=0.05 * scale
            )
        elif kind == "rod":
            piece = random_rod(rng, scale * float(rng.uniform(0.4, 1.6)))
        else:
            piece = [mesh_primitives.frustum(DARK, 0.1 * scale, 0.3 * scale, 0.15 * scale).translated(z=0.1 * scale)]
        spot = rng.uniform(-0.35, 0.35, 2)
        piece = mesh_primitives.translated(piece, float(spot[0]) * x, float(spot[1]) * y, 0.5 * z)
        solids += mesh_primitives.rotated(piece, "x", 90.0 * int(rng.integers(4))) if abs(y - z) < 0.3 * z else piece
    return solids


def random_truss(rng: Rng, material: Material, length: float, side: float) -> Solids:
    """A lattice beam along x."""
    bar = 0.12 * side
    solids = [
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
        solids += mesh_primitives.translated(frame, x)
    if rng.random() < 0.7:
        solids += [mesh_primitives.box(random_bus_material(rng), 0.9 * length, 0.7 * side, 0.7 * side)]
    return solids
