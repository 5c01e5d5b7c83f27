"""Small functions of a vector (3,), a matrix (3, 3) and a number, with one class of JAX's operations each."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax


class Case(NamedTuple):
    """A function, and whether JAX differentiates it in forward and in reverse mode."""

    function: Callable[[Any, Any, Any], Any]
    forward: bool = True
    reverse: bool = True


def regular(m: Any) -> Any:
    """A well-conditioned symmetric matrix made from any."""
    return m @ m.T + 5.0 * jnp.eye(3)


@jax.custom_jvp
def steep(x: Any) -> Any:
    """A function with an arbitrary custom derivative."""
    return x * 0.0


@steep.defjvp
def _steep_jvp(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
    return steep(primals[0]), 5.0 * primals[0] * tangents[0]


@jax.custom_vjp
def clipped(x: Any, s: Any) -> Any:
    """A function with an arbitrary custom gradient."""
    return x * s


clipped.defvjp(lambda x, s: (x * s, x), lambda x, g: (3.0 * g * x, jnp.sum(g)))


@jax.custom_batching.custom_vmap
def doubled(x: Any) -> Any:
    """A function with a batching rule of its own."""
    return 2.0 * x


doubled.def_vmap(lambda size, batched, x: (2.0 * x, batched[0]))


def loops(x: Any, m: Any, s: Any) -> Any:
    """A loop in a loop, backwards, with a carry that becomes batched only in the second iteration."""

    def body(carry: Any, row: Any) -> Any:
        own, later, common = carry
        inner = lax.scan(lambda total, each: (total * 0.5 + each, total), own, row)
        return (inner[0] + s, later + own, common + 1.0), (jnp.sum(inner[1]), common)

    zero = jnp.zeros(())
    return lax.scan(body, (zero, zero, zero), m, reverse=True, unroll=2)


def conditionals(x: Any, m: Any, s: Any) -> Any:
    """Conditionals within each other and in a loop, on an index of the element and on one of all."""

    def body(total: Any, number: Any) -> Any:
        return lax.cond(number > 1, lambda: total + x, lambda: lax.cond(s > 0.0, lambda: total, lambda: total - x)), s

    which = (s > 0.0).astype(jnp.int32) + (s > 1.0).astype(jnp.int32)
    return lax.scan(body, x, jnp.arange(3)), lax.switch(which, [lambda: m[0] * s, lambda: x, lambda: x * x])


def while_loops(x: Any, m: Any, s: Any) -> Any:
    """Loops that last differently long for each element."""
    count = lax.while_loop(lambda c: jnp.sum(c[1]) < 9.0, lambda c: (c[0] + 1, c[1] + 0.5), (0, x * x))
    return count, lax.fori_loop(0, jnp.round(s * s).astype(int), lambda i, y: y + x[0] * i, s)


def out_of_range(x: Any, m: Any, s: Any) -> Any:
    """Starts of slices that are clamped, not counted from the end."""
    starts = [-1, -4, -9, 7]
    own = jnp.round(s * 3.0).astype(int)
    return [lax.dynamic_slice(x, (start,), (1,)) for start in (*starts, own)], m[-2], m.at[7].get(mode="clip")


def sorted_and_scattered(x: Any, m: Any, s: Any) -> Any:
    """Several operands sorted by one, and numbers written at places of all and of the element."""
    place = jnp.argmax(x)
    scattered = x.at[1].add(s), x.at[place].set(s), x.at[place].max(s), x.at[0].mul(s), m.at[place, 1].min(s)
    moved = lax.dynamic_update_slice(x, s[None], (place,))
    return lax.sort((x, x * s), num_keys=1), jnp.argsort(x), jnp.cumsum(m, axis=1), scattered, moved


def rematerialised(x: Any, m: Any, s: Any) -> Any:
    """Functions that reverse mode evaluates twice, within a loop too, and under a derivative."""
    product = jax.checkpoint(lambda y: jnp.sin(m @ jnp.sin(y)), policy=jax.checkpoint_policies.dots_saveable)
    looped = lax.scan(lambda y, _: (jax.checkpoint(jnp.sin)(y) * s, None), x, None, length=3)[0]
    return product(x), looped, jax.grad(lambda y: jnp.sum(product(y)))(x)


def random_numbers(x: Any, m: Any, s: Any) -> Any:
    """Random numbers from keys of the element, old and new."""
    word = jnp.round(jnp.abs(s) * 1e6).astype(jnp.uint32)
    old, new = jax.random.fold_in(jax.random.PRNGKey(3), word), jax.random.fold_in(jax.random.key(3), word)
    chosen = jnp.where(s > 0.0, jax.random.split(new, 3), jax.random.split(new, 3)[::-1])
    return jax.random.normal(old, (3,)) * x, jax.random.normal(new, (3,)) * x, jax.random.bits(chosen[0])


def types(x: Any, m: Any, s: Any) -> Any:
    """Integers, flags, other floating-point types, and the bits of numbers."""
    halves = lax.bitcast_convert_type(x, jnp.uint32)
    return x.astype(jnp.float32), x > s, jnp.round(x).astype(int) ^ 3, halves, lax.bitcast_convert_type(halves, float)


def nested_derivatives(x: Any, m: Any, s: Any) -> Any:
    """Derivatives in both modes within the function, through loops and compiled functions."""

    def total(y: Any) -> Any:
        return jnp.sum(lax.scan(lambda carry, row: (jax.jit(jnp.sin)(carry) * row, None), y, m)[0])

    return jax.grad(total)(x), jax.jvp(total, (x,), (m[0],)), jax.jacfwd(jax.grad(total))(x)


def called(x: Any, m: Any, s: Any) -> Any:
    """Compiled functions, one of them with a place of its own."""
    placed = jax.jit(jnp.cos, out_shardings=jax.sharding.SingleDeviceSharding(jax.devices()[0]))
    return jax.jit(lambda y: (y, jnp.sin(y) * s))(x), placed(x)


def linear_solvers(x: Any, m: Any, s: Any) -> Any:
    """Systems of linear equations, factors, and a root found by iteration with an implicit derivative."""
    root = lax.custom_root(
        lambda y: y**3 + y - s,
        jnp.zeros(()),
        lambda f, y: lax.fori_loop(0, 8, lambda _, z: z - f(z) / (3.0 * z**2 + 1.0), y),
        lambda g, y: y / g(jnp.ones(())),
    )
    return jnp.linalg.solve(regular(m), x), jnp.linalg.cholesky(regular(m)), jnp.linalg.inv(regular(m)), root


def callback(x: Any, m: Any, s: Any) -> Any:
    """A function of the host."""
    return jax.pure_callback(np.sin, jax.ShapeDtypeStruct((3,), float), x, vmap_method="sequential") * s


ZOO = {
    "elementwise": Case(lambda x, m, s: (jnp.sin(x) * s + 2.0, jnp.where(s > 0.0, x, -x), jnp.clip(x, -s * s, 1.0))),
    "selections": Case(
        lambda x, m, s: (lax.select_n(jnp.argmax(x), s, x[0], m[0, 0]), jnp.where(m > s, m, x[:, None]))
    ),
    "shapes": Case(lambda x, m, s: (m.T.reshape(9), lax.pad(x, s, [(2, -1, 1)]), jnp.roll(m, 1), jnp.diag(x))),
    "products": Case(
        lambda x, m, s: (m @ x, jnp.einsum("ij,jk,k->i", m, m, x), jnp.cross(x, m[0]), jnp.linalg.norm(x))
    ),
    "reductions": Case(
        lambda x, m, s: (jnp.sum(m, axis=1), jnp.max(m, axis=0), jnp.argmin(x), jnp.prod(x), lax.top_k(x, 2))
    ),
    "computed reduction": Case(
        lambda x, m, s: lax.reduce(m, np.float64(1.0), lambda a, b: a * b + a, (0,)), False, False
    ),
    "windows": Case(
        lambda x, m, s: lax.reduce_window(m, np.float64(0.0), lambda a, b: a + 2.0 * b, (2, 1), (1, 1), "VALID"),
        False,
        False,
    ),
    "transforms": Case(
        lambda x, m, s: (jnp.abs(jnp.fft.fft(x)), lax.associative_scan(jnp.multiply, m), jnp.convolve(x, x))
    ),
    "loops": Case(loops),
    "conditionals": Case(conditionals),
    "while loops": Case(while_loops, reverse=False),
    "out of range": Case(out_of_range),
    "sorted and scattered": Case(sorted_and_scattered),
    "custom derivative": Case(lambda x, m, s: (steep(x) * s, lax.scan(lambda c, r: (steep(c), r), x, m))),
    "custom gradient": Case(lambda x, m, s: clipped(x, s) + clipped(m[0], x[0]), forward=False),
    "rematerialised": Case(rematerialised),
    "linear solvers": Case(linear_solvers),
    "random numbers": Case(random_numbers),
    "types": Case(types),
    "nested derivatives": Case(nested_derivatives),
    "called": Case(called),
    "choice by platform": Case(lambda x, m, s: lax.platform_dependent(x, s, cpu=jnp.multiply, default=lambda x, s: x)),
    "callback": Case(callback, False, False),
    "own batching rule": Case(lambda x, m, s: doubled(x) * s, reverse=False),
    "shared by all": Case(lambda x, m, s: (jnp.arange(3.0) * 2.0, x)),
}
