"""Solids of triangles, from which procedural spacecraft are built."""

import dataclasses

import numpy as np

from rpojax.training.synthetic_data.meshes.target_mesh import Material, MeshPart, TargetMesh

Rng = np.random.Generator
WHITE = Material(color=(0.8, 0.8, 0.78), roughness=0.6)
DARK = Material(color=(0.04, 0.04, 0.045), roughness=0.6)


@dataclasses.dataclass(frozen=True)
class Solid:
    """Triangles of one material: vertices (n, 3) [m], faces (m, 3)."""

    material: Material
    vertices: np.ndarray
    faces: np.ndarray

    def translated(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Solid":
        """The solid translated [m]."""
        return dataclasses.replace(self, vertices=self.vertices + np.array([x, y, z]))

    def rotated(self, axis: str, angle_deg: float) -> "Solid":
        """The solid rotated about an axis through the origin."""
        return dataclasses.replace(self, vertices=self.vertices @ rotation_matrix(axis, angle_deg).T)


Solids = list[Solid]


def rotation_matrix(axis: str, angle_deg: float) -> np.ndarray:
    """Matrix (3, 3) of a right-handed rotation about 'x', 'y' or 'z'."""
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    matrix = np.eye(3)
    matrix[first, first], matrix[first, second] = cosine, -sine
    matrix[second, first], matrix[second, second] = sine, cosine
    return matrix


def translated(solids: Solids, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solids:
    """All solids translated [m]."""
    return [solid.translated(x, y, z) for solid in solids]


def rotated(solids: Solids, axis: str, angle_deg: float) -> Solids:
    """All solids rotated about an axis through the origin."""
    return [solid.rotated(axis, angle_deg) for solid in solids]


def box(material: Material, x: float, y: float, z: float) -> Solid:
    """A box around the origin."""
    corners = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])
    return Solid(material, corners * [x, y, z], faces)


def crinkled_box(rng: np.random.Generator, material: Material, x: float, y: float, z: float) -> Solid:
    """A box whose faces are crinkled like foil: grids of points with random heights."""
    sides = []
    dent = 0.012 * max(x, y, z)
    for axis, (u, v, w) in {"x": (y, z, x), "y": (z, x, y), "z": (x, y, z)}.items():
        for sign in (-1.0, 1.0):
            sheet = _sheet(rng, material, u, v, dent).translated(z=0.5 * w)
            sides.append(_permute_axes(sheet if sign > 0.0 else sheet.rotated("x", 180.0), axis))
    return merge_solids(sides)


def _sheet(rng: np.random.Generator, material: Material, x: float, y: float, dent: float) -> Solid:
    count = 7
    steps = np.linspace(-0.5, 0.5, count)
    across, down = np.meshgrid(steps, steps, indexing="ij")
    inner = (np.abs(across) < 0.49) & (np.abs(down) < 0.49)
    height = np.where(inner, dent * rng.normal(size=across.shape), 0.0)
    vertices = np.stack([across * x, down * y, height], axis=-1).reshape(-1, 3)
    return Solid(material, vertices, _grid_faces(count, count))


def _permute_axes(solid: Solid, axis: str) -> Solid:
    """A solid along z, with its axes cyclically permuted to another axis."""
    order = {"z": [0, 1, 2], "x": [2, 0, 1], "y": [1, 2, 0]}[axis]
    return dataclasses.replace(solid, vertices=solid.vertices[:, order])


def _grid_faces(rows: int, columns: int) -> np.ndarray:
    """Triangles (m, 3) of a grid of points, numbered row by row."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)[None, :]).reshape(-1)
    a, b, c, d = first, first + columns, first + columns + 1, first + 1
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def surface_of_revolution(material: Material, profile: list[tuple[float, float]], sections: int = 28) -> Solid:
    """Surface of revolution about z of a profile of (radius, height)."""
    angle = np.linspace(0.0, 2.0 * np.pi, sections + 1)
    radius, height = np.array(profile).T
    shape = (len(profile), sections + 1)
    vertices = np.stack(
        [
            radius[:, None] * np.cos(angle)[None, :],
            radius[:, None] * np.sin(angle)[None, :],
            np.broadcast_to(height[:, None], shape),
        ],
        axis=-1,
    )
    return Solid(material, vertices.reshape(-1, 3), _grid_faces(*shape))


def frustum(
    material: Material, radius: float, length: float, end_radius: float | None = None, sections: int = 28
) -> Solid:
    """A closed cylinder, cone or prism along z around the origin; `end_radius` is that at its +z side."""
    other = radius if end_radius is None else end_radius
    half = 0.5 * length
    return surface_of_revolution(material, [(0.0, -half), (radius, -half), (other, half), (0.0, half)], sections)


def crinkled_cylinder(rng: np.random.Generator, material: Material, radius: float, length: float) -> Solid:
    """A closed cylinder along z, crinkled like foil."""
    rows = 14
    heights = np.linspace(-0.5 * length, 0.5 * length, rows)
    solid = surface_of_revolution(material, [(0.0, heights[0]), *((radius, h) for h in heights), (0.0, heights[-1])])
    dents = 0.015 * radius * rng.normal(size=solid.vertices.shape)
    return dataclasses.replace(solid, vertices=solid.vertices + dents)


def paraboloid(material: Material, radius: float, depth: float) -> Solid:
    """An open paraboloid with its apex at the origin and its rim at +z."""
    fraction = np.linspace(0.0, 1.0, 7)
    return surface_of_revolution(material, [(radius * s, depth * s * s) for s in fraction])


def extruded_polygon(material: Material, outline: list[tuple[float, float]], thickness: float) -> Solid:
    """A flat plate around z = 0 with a convex outline in x and y."""
    count = len(outline)
    points = np.array(outline)
    layers = [np.column_stack([points, np.full(count, side * 0.5 * thickness)]) for side in (-1.0, 1.0)]
    fan = [(0, i, i + 1) for i in range(1, count - 1)]
    upper = [(count, count + i, count + i + 1) for i in range(1, count - 1)]
    rim = [
        triangle
        for i in range(count)
        for j in [(i + 1) % count]
        for triangle in ((i, j, count + j), (i, count + j, count + i))
    ]
    return Solid(material, np.concatenate(layers), np.array(fan + upper + rim))


def merge_solids(solids: list[Solid]) -> Solid:
    """The solids as one, of the material of the first."""
    offsets = np.cumsum([0, *(len(solid.vertices) for solid in solids[:-1])])
    faces = [solid.faces + offset for solid, offset in zip(solids, offsets, strict=True)]
    return Solid(solids[0].material, np.concatenate([solid.vertices for solid in solids]), np.concatenate(faces))


def as_mesh(name: str, solids: Solids) -> TargetMesh:
    """Mesh with one part per material, the centre of its box at the origin."""
    parts = []
    for material in dict.fromkeys(solid.material for solid in solids):
        whole = merge_solids([solid for solid in solids if solid.material == material])
        parts.append(MeshPart(whole.vertices, whole.faces, material))
    center = TargetMesh(name, tuple(parts)).bounds.mean(axis=0)
    return TargetMesh(name, tuple(dataclasses.replace(part, vertices=part.vertices - center) for part in parts))


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


def random_bus(rng: Rng, material: Material, x: float, y: float, z: float) -> Solid:
    """A bus of a size [m], mostly crinkled if it is of metal."""
    foil = material.metallic > 0.5 and rng.random() < 0.8
    return crinkled_box(rng, material, x, y, z) if foil else box(material, x, y, z)


def _panel(rng: Rng, cells: Material, frame: Material, width: float, length: float) -> Solids:
    """A panel in the x-y plane, from y = 0 on, with rows of cells on its +z side."""
    solids = [box(frame, width, length, 0.015 * max(width, 0.3)).translated(y=0.5 * length)]
    across, along = int(rng.integers(1, 6)), int(np.clip(round(length / width * rng.integers(2, 6)), 2, 24))
    gap = float(rng.uniform(0.85, 0.97))
    for column in range(across):
        for row in range(along):
            size = (width / across * gap, length / along * gap, 0.004)
            place = ((column + 0.5) / across - 0.5) * width, (row + 0.5) / along * length
            solids.append(box(cells, *size).translated(*place, 0.012 * max(width, 0.3)))
    return solids


def random_wing(rng: Rng, cells: Material, frame: Material, width: float, lengths: list[float], boom: float) -> Solids:
    """A wing along +y: a boom, then panels one after the other."""
    solids = [box(frame, 0.06 * width, boom, 0.06 * width).translated(y=0.5 * boom)] if boom > 0.0 else []
    at = boom
    for length in lengths:
        solids += translated(_panel(rng, cells, frame, width, length), y=at)
        at += length * 1.03
    return solids


def random_wings(rng: Rng, half_m: float, width: float, panels: int, length: float, count: int = 2) -> Solids:
    """Equal wings evenly spaced round the x axis, rotated alike about their booms."""
    cells, frame = random_solar_cell_material(rng), random_bus_material(rng)
    wing = random_wing(rng, cells, frame, width, [length] * panels, float(rng.uniform(0.05, 0.4)) * width)
    wing = translated(rotated(wing, "y", float(rng.uniform(-90.0, 90.0))), y=half_m)
    return [solid for i in range(count) for solid in rotated(wing, "x", 360.0 * i / count)]


def random_antenna(rng: Rng, size: float) -> Solids:
    """A dish with its feed, open to +z."""
    material = WHITE if rng.random() < 0.6 else random_bus_material(rng)
    feed = frustum(DARK, 0.06 * size, 0.5 * size).translated(z=0.3 * size)
    return [paraboloid(material, size, float(rng.uniform(0.2, 0.5)) * size), feed]


def random_rod(rng: Rng, length: float) -> Solids:
    """A thin boom along +z."""
    return [frustum(random_bus_material(rng), 0.012 * length, length, sections=6).translated(z=0.5 * length)]


def nozzle(radius: float) -> Solids:
    """An engine bell open to -z."""
    return [surface_of_revolution(DARK, [(0.35 * radius, 0.0), (0.6 * radius, -0.6 * radius), (radius, -1.5 * radius)])]


def random_appendages(rng: Rng, x: float, y: float, z: float) -> Solids:
    """Random appendages of a bus of a size [m]: boxes, dishes, rods, baffles."""
    solids: Solids = []
    scale = (x * y * z) ** (1.0 / 3.0)
    for _ in range(int(rng.integers(1, 7))):
        kind = rng.choice(["box", "dish", "rod", "baffle"], p=[0.4, 0.2, 0.2, 0.2])
        if kind == "box":
            sides = scale * rng.uniform(0.08, 0.4, 3)
            piece = [box(random_bus_material(rng), *map(float, sides))]
        elif kind == "dish":
            piece = translated(random_antenna(rng, scale * float(rng.uniform(0.15, 0.5))), z=0.05 * scale)
        elif kind == "rod":
            piece = random_rod(rng, scale * float(rng.uniform(0.4, 1.6)))
        else:
            piece = [frustum(DARK, 0.1 * scale, 0.3 * scale, 0.15 * scale).translated(z=0.1 * scale)]
        spot = rng.uniform(-0.35, 0.35, 2)
        piece = translated(piece, float(spot[0]) * x, float(spot[1]) * y, 0.5 * z)
        solids += rotated(piece, "x", 90.0 * int(rng.integers(4))) if abs(y - z) < 0.3 * z else piece
    return solids


def random_truss(rng: Rng, material: Material, length: float, side: float) -> Solids:
    """A lattice beam along x."""
    bar = 0.12 * side
    solids = [
        box(material, length, bar, bar).translated(y=y, z=z)
        for y in (-0.5 * side, 0.5 * side)
        for z in (-0.5 * side, 0.5 * side)
    ]
    bays = max(2, int(length / side))
    for bay in range(bays + 1):
        x = (bay / bays - 0.5) * length
        frame = [box(material, bar, side, bar).translated(z=z) for z in (-0.5 * side, 0.5 * side)]
        frame += [box(material, bar, bar, side).translated(y=y) for y in (-0.5 * side, 0.5 * side)]
        frame += [box(material, bar, bar, 1.35 * side).rotated("x", 45.0)]
        solids += translated(frame, x)
    if rng.random() < 0.7:
        solids += [box(random_bus_material(rng), 0.9 * length, 0.7 * side, 0.7 * side)]
    return solids
