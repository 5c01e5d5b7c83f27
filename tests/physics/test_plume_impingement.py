"""Plumes on surfaces: momentum of the plume, force laws, symmetry, shadow, numbers worked by hand, derivatives."""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.integrate import quad
from scipy.spatial import ConvexHull

from rpojax.core.pytree import replace
from rpojax.physics import plume_impingement
from rpojax.physics.plume_impingement import Facets, Plume
from rpojax.scenario.trained.coverage_surface import hull_triangles

THRUST = 0.25
BOX = np.array([[x, y, z] for x in (-0.25, 0.25) for y in (-0.25, 0.25) for z in (-0.3, 0.3)])
_loads = jax.jit(plume_impingement.loads)
_moment = jax.jit(plume_impingement.moment, static_argnums=1)
_shape = jax.jit(plume_impingement.shape)
_density = jax.jit(plume_impingement.relative_density)


def plume(**changes: float) -> Plume:
    """Nitrogen on a cold, absorbing surface, unless changed."""
    numbers = {
        "specific_heat_ratio": 1.4,
        "exit_mach": 5.0,
        "nozzle_half_angle": math.radians(15.0),
        "boundary_layer": 0.1,
        "accommodation": 1.0,
        "wall_temperature": 0.0,
    }
    return Plume(**{name: jnp.array(value) for name, value in (numbers | changes).items()})


def load(plume: Plume, facets: Facets, source: list[float], flow: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Force and torque of one thruster whose plume goes along a direction."""
    force = -THRUST * np.array(flow) / np.linalg.norm(flow)
    return tuple(np.asarray(each[0]) for each in _loads(plume, facets, jnp.array([source]), jnp.array([force])))  # pyright: ignore[reportReturnType]


def facets(centers: np.ndarray, normals: np.ndarray, areas: np.ndarray) -> Facets:
    return Facets(centers=jnp.asarray(centers), normals=jnp.asarray(normals), areas=jnp.asarray(areas))


def plate_to_the_horizon(distance: float) -> Facets:
    """Plate across the x axis that closes all angles below 90 deg but 1e-3 rad, in rings of equal steps of angle."""
    edges = np.linspace(0.0, 0.5 * math.pi - 1e-3, 801)
    around = 2.0 * math.pi * (np.arange(24) + 0.5) / 24
    middle, radii = 0.5 * (edges[1:] + edges[:-1]), distance * np.tan(edges)
    area = np.repeat(math.pi * (radii[1:] ** 2 - radii[:-1] ** 2) / 24, 24)
    y, z = (np.ravel(np.outer(distance * np.tan(middle), each)) for each in (np.cos(around), np.sin(around)))
    centers = np.stack([np.full_like(y, distance), y, z], axis=1)
    return facets(centers, np.tile([-1.0, 0.0, 0.0], (len(y), 1)), area)


def sphere(radius: float, splits: int) -> Facets:
    """Even rings about x on a sphere, with the area and the normals of the sphere."""
    edges = np.linspace(-1.0, 1.0, splits + 1)
    x = 0.5 * (edges[1:] + edges[:-1])
    around = 2.0 * math.pi * (np.arange(2 * splits) + 0.5) / (2 * splits)
    across = np.sqrt(1.0 - x**2)[:, None]
    normals = np.stack(
        [np.broadcast_to(x[:, None], (splits, 2 * splits)), across * np.cos(around), across * np.sin(around)], axis=-1
    ).reshape(-1, 3)
    return facets(radius * normals, normals, np.full(len(normals), 4.0 * math.pi * radius**2 / len(normals)))


@pytest.mark.parametrize("gamma", [1.2, 1.4, 1.6])
@pytest.mark.parametrize("layer", [0.005, 0.1, 0.4])
def test_moments_agree_with_adaptive_quadrature(gamma: float, layer: float) -> None:
    form = _shape(plume(specific_heat_ratio=gamma, boundary_layer=layer))
    border = min(float(form.border), 0.5 * math.pi)
    for power in (0, 1):

        def integrand(angle: float, power: int = power) -> float:
            return float(_density(form, jnp.array(angle))) * math.sin(angle) * math.cos(angle) ** power

        expected = quad(integrand, 0.0, border)[0] + quad(integrand, border, 0.5 * math.pi)[0]
        assert float(_moment(form, power)) == pytest.approx(expected, rel=1e-7)


def test_angles_of_the_far_field_agree_with_numbers_worked_by_hand() -> None:
    # Limit of turning of nitrogen 130.45 deg, Prandtl-Meyer angle at Mach 5 76.92 deg (NACA report 1135).
    form = _shape(plume())
    limit = 130.45 - 76.92 + 15.0
    assert 90.0 / float(form.stretch) == pytest.approx(limit, abs=0.01)
    assert float(form.power) == pytest.approx(5.0)
    border = limit * (1.0 - 2.0 / math.pi * 0.2 ** (1.0 / 6.0))
    assert math.degrees(float(form.border)) == pytest.approx(border, abs=0.01)
    core = math.cos(math.radians(20.0) * float(form.stretch)) ** 5
    assert float(_density(form, jnp.radians(20.0))) == pytest.approx(core, rel=1e-12)


def test_density_and_its_slope_are_continuous_where_the_boundary_layer_begins() -> None:
    form = _shape(plume())
    below, above = (float(form.border) + sign * 1e-7 for sign in (-1.0, 1.0))
    slope = jax.grad(lambda angle: plume_impingement.relative_density(form, angle))
    assert float(_density(form, jnp.array(below))) == pytest.approx(float(_density(form, jnp.array(above))), rel=1e-5)
    assert float(slope(below)) == pytest.approx(float(slope(above)), rel=1e-5)


@pytest.mark.parametrize("layer", [0.02, 0.05, 0.1, 0.2])
def test_the_gas_beyond_the_border_is_that_of_the_boundary_layer(layer: float) -> None:
    """Its mass over that of the flow through the ring of the layer at the exit's full mass flux is 0.5 to 1."""
    form = _shape(plume(boundary_layer=layer))

    def integrand(angle: float) -> float:
        return float(_density(form, jnp.array(angle))) * math.sin(angle)

    beyond = quad(integrand, float(form.border), 0.5 * math.pi)[0]
    share = beyond / (beyond + quad(integrand, 0.0, float(form.border))[0])
    assert 0.5 < share / (1.0 - (1.0 - layer) ** 2) < 1.0


@pytest.mark.parametrize("accommodation", [1.0, 0.6, 0.0])
@pytest.mark.parametrize("gamma", [1.25, 1.4])
def test_a_plate_that_closes_the_plume_takes_its_thrust(accommodation: float, gamma: float) -> None:
    gas = plume(accommodation=accommodation, specific_heat_ratio=gamma)
    force, torque = load(gas, plate_to_the_horizon(2.0), [0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    # Absorbed momentum is taken once, reflected momentum twice.
    np.testing.assert_allclose(force, [(2.0 - accommodation) * THRUST, 0.0, 0.0], rtol=3e-4, atol=1e-12)
    np.testing.assert_allclose(torque, 0.0, atol=1e-10)


def test_molecules_that_leave_a_warm_plate_push_it_by_their_own_speed() -> None:
    form, gas = _shape(plume()), plume(wall_temperature=1.0)
    force, _ = load(gas, plate_to_the_horizon(2.0), [0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    # sqrt(pi R T / 2) over sqrt(2 gamma R T / (gamma - 1)), for each molecule of the mass flux.
    leaving = math.sqrt(0.5 * math.pi) / math.sqrt(2.0 * 1.4 / 0.4)
    share = float(_moment(form, 0)) / float(_moment(form, 1))
    assert force[0] / THRUST == pytest.approx(1.0 + leaving * share, rel=3e-4)


@pytest.mark.parametrize("flow", [[1.0, 0.0, 0.0], [1.0, 0.5, 0.0]])
def test_force_falls_with_the_square_of_the_distance(flow: list[float]) -> None:
    small = facets(np.zeros((1, 3)), np.array([[-1.0, 0.0, 0.0]]), np.array([0.01]))
    near, far = (load(plume(), small, [-distance, 0.0, 0.0], flow)[0][0] for distance in (2.0, 6.0))
    assert near > 0.0
    assert near / far == pytest.approx(9.0, rel=1e-12)


def test_a_facet_gets_nothing_from_behind_nor_behind_the_thruster() -> None:
    one = facets(np.zeros((1, 3)), np.array([[-1.0, 0.0, 0.0]]), np.array([0.1]))
    assert load(plume(), one, [-3.0, 0.0, 0.0], [1.0, 0.0, 0.0])[0][0] > 0.0
    for source, flow in (([3.0, 0.0, 0.0], [-1.0, 0.0, 0.0]), ([-3.0, 0.0, 0.0], [-1.0, 0.0, 0.0])):
        for found in load(plume(), one, source, flow):
            np.testing.assert_array_equal(found, 0.0)


def test_a_closed_valve_and_a_facet_at_the_nozzle_give_finite_numbers() -> None:
    one = facets(np.zeros((1, 3)), np.array([[-1.0, 0.0, 0.0]]), np.array([0.1]))

    def size(source: jax.Array, force: jax.Array) -> jax.Array:
        return sum(jnp.sum(each) for each in plume_impingement.loads(plume(), one, source, force))  # pyright: ignore[reportReturnType]

    for place, push in ((-1e-3, -THRUST), (-2.0, 0.0), (0.0, -THRUST)):
        at, force = jnp.array([[place, 0.0, 0.0]]), jnp.array([[push, 0.0, 0.0]])
        values = (size(at, force), *jax.grad(size, argnums=(0, 1))(at, force))
        assert all(np.isfinite(each).all() for each in values)


@pytest.mark.parametrize("distance", [1e-6, 0.01, 0.05, 0.126, 0.2, 0.4, 1.0])
def test_an_absorbing_surface_takes_no_more_than_the_thrust(distance: float) -> None:
    one = facets(np.zeros((1, 3)), np.array([[-1.0, 0.0, 0.0]]), np.array([0.1]))
    force, _ = load(plume(), one, [-distance, 0.0, 0.0], [1.0, 0.0, 0.0])
    assert 0.0 < force[0] <= THRUST * (1.0 + 1e-12)
    if distance < 0.1:
        assert force[0] == pytest.approx(THRUST)
    box = plume_impingement.facets_of(hull_triangles(BOX))
    force, _ = load(plume(), box, [-0.25 - distance, 0.05, 0.02], [1.0, 0.0, 0.0])
    assert 0.0 < force[0] <= THRUST * (1.0 + 1e-12)


@pytest.mark.parametrize("accommodation", [1.0, 0.0])
def test_force_on_a_small_far_sphere_agrees_with_the_integral_by_hand(accommodation: float) -> None:
    """Absorbed: its cross-section times the dynamic pressure. Reflected: the same, as all directions come back."""
    radius, distance = 0.05, 5.0
    found, torque = load(plume(accommodation=accommodation), sphere(radius, 60), [-distance, 0.0, 0.0], [1.0, 0.0, 0.0])
    pressure = THRUST / (2.0 * math.pi * float(_moment(_shape(plume()), 1)) * distance**2)
    # Reflected: 2 cos^2 of incidence over the half sphere is 2 pi R^2 times the integral of 2 c^3 = 1/2.
    expected = pressure * math.pi * radius**2
    np.testing.assert_allclose(found, [expected, 0.0, 0.0], rtol=0.01, atol=1e-9)
    np.testing.assert_allclose(torque, 0.0, atol=1e-12)


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
def test_a_plume_along_an_axis_of_symmetry_turns_nothing(direction: list[float]) -> None:
    box = plume_impingement.facets_of(hull_triangles(BOX))
    even = replace(plume(), accommodation=jnp.array(0.7), wall_temperature=jnp.array(1.0))
    force, torque = load(even, box, list(-3.0 * np.array(direction)), direction)
    across = force - np.dot(force, direction) * np.array(direction)
    assert np.dot(force, direction) > 0.0
    # Triangles of a face are symmetric to its middle only together.
    np.testing.assert_allclose(across, 0.0, atol=1e-12)
    np.testing.assert_allclose(torque, 0.0, atol=1e-12)


def test_a_plume_beside_the_center_pushes_its_side_away() -> None:
    box = plume_impingement.facets_of(hull_triangles(BOX))
    force, torque = load(plume(accommodation=0.0), box, [-3.0, 0.2, 0.0], [1.0, 0.0, 0.0])
    # Reflected, so pushed along x alone. The centres of the two triangles of the face are at y of 83 and -83 mm and off
    # the axis by 0.056 and 0.109 rad: log of the ratio of their forces 0.0088 (n k^2 / 2 + 2) = 0.0555.
    assert -torque[2] / force[0] == pytest.approx(0.25 / 3.0 * math.tanh(0.5 * 0.0555), rel=0.02)


def test_force_and_torque_are_sums_over_facets() -> None:
    """Against a loop over the facets that is written as the equations are."""
    rng = np.random.default_rng(3)
    gas = plume(accommodation=0.8, wall_temperature=0.7)
    body = plume_impingement.facets_of(hull_triangles(rng.normal(size=(10, 3)) * 0.4))
    form = _shape(gas)
    strength = THRUST / (2.0 * math.pi * float(_moment(form, 1)))
    leaving = math.sqrt(0.25 * math.pi * 0.4 / 1.4 * 0.7)
    source, axis = np.array([-3.0, 0.3, -0.2]), np.array([0.9, 0.1, 0.05])
    force, torque = np.zeros(3), np.zeros(3)
    for center, normal, area in zip(*map(np.asarray, (body.centers, body.normals, body.areas)), strict=True):
        distance = np.linalg.norm(center - source)
        flow = (center - source) / distance
        facing = max(0.0, -normal @ flow)
        angle = math.acos(flow @ axis / np.linalg.norm(axis))
        pressure = strength * float(_density(form, jnp.array(angle))) / distance**2
        diffuse = 0.8 * (flow - leaving * normal)
        each = pressure * area * facing * (diffuse - 0.2 * 2.0 * facing * normal)
        force, torque = force + each, torque + np.cross(center, each)
    found = load(gas, body, list(source), list(axis))
    np.testing.assert_allclose(found[0], force, rtol=1e-10)
    np.testing.assert_allclose(found[1], torque, rtol=1e-9, atol=1e-12)


def test_facets_of_a_hull_close_it() -> None:
    body = plume_impingement.facets_of(hull_triangles(BOX))
    areas, normals, centers = (np.asarray(each) for each in (body.areas, body.normals, body.centers))
    np.testing.assert_allclose(areas @ normals, 0.0, atol=1e-15)
    volume = np.sum(areas * np.sum(normals * centers, axis=1)) / 3.0
    assert volume == pytest.approx(ConvexHull(BOX).volume, rel=1e-12)


def _of_plume(x: jax.Array) -> jax.Array:
    gas = plume(accommodation=0.8, wall_temperature=1.0)
    changed = replace(
        gas,
        specific_heat_ratio=gas.specific_heat_ratio + 0.1 * x[0],
        exit_mach=gas.exit_mach + x[1],
        boundary_layer=gas.boundary_layer + 0.1 * x[2],
        accommodation=gas.accommodation + 0.1 * x[3],
        wall_temperature=gas.wall_temperature + 0.1 * x[4],
        nozzle_half_angle=gas.nozzle_half_angle + 0.1 * x[5],
    )
    force, torque = plume_impingement.loads(changed, _BODY, _SOURCES, _FORCES)
    return 10.0 * jnp.concatenate([force, torque], axis=1)


def _of_geometry(x: jax.Array) -> jax.Array:
    gas = plume(accommodation=0.8, wall_temperature=1.0)
    sources, forces = _SOURCES + 0.1 * x[:6].reshape(2, 3), _FORCES * (1.0 + 0.1 * x[6:].reshape(2, 3))
    force, torque = plume_impingement.loads(gas, _BODY, sources, forces)
    return 10.0 * jnp.concatenate([force, torque], axis=1)


_BODY = plume_impingement.facets_of(hull_triangles(np.random.default_rng(1).normal(size=(9, 3)) * 0.4))
_SOURCES = jnp.array([[-2.5, 0.3, -0.2], [0.4, 2.0, 1.5]])
_FORCES = jnp.array([[-0.2, 0.15, 0.02], [0.05, 0.15, 0.1]])


@pytest.mark.parametrize(("function", "size"), [(_of_plume, 6), (_of_geometry, 12)])
def test_derivatives_agree_with_differences(function: Callable[[jax.Array], jax.Array], size: int) -> None:
    assert np.abs(np.asarray(function(jnp.zeros(size)))).max(axis=1).min() > 1e-3
    check_grads(jax.jit(function), (jnp.zeros(size),), order=1, modes=["fwd", "rev"], atol=1e-6, rtol=1e-6)
