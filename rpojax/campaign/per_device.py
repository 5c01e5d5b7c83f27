"""One function compiled for several devices, each of which runs a program of its own."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
from jax.extend import core


def compiled(
    function: Callable[..., Any],
    shares: Sequence[tuple[Any, ...]],
    compile_one: Callable[[Any], Any] = lambda lowered: lowered.compile(),
    donate: tuple[int, ...] = (),
) -> list[Any]:
    """Programs of `function` for arguments of the same shapes that lie on each device; `donate` numbers those given up.

    Traced once for all, since that takes longer than anything else of a program that is in the cache.
    """
    traced, shape = jax.make_jaxpr(function, return_shape=True)(*shares[0])
    tree = jax.tree.structure(shape)

    def run(*arguments: Any) -> Any:
        return jax.tree.unflatten(tree, core.jaxpr_as_fun(traced)(*jax.tree.leaves(arguments)))

    wanted = jax.jit(run, donate_argnums=donate)
    lowered = [wanted.lower(*share) for share in shares]
    with ThreadPoolExecutor(len(lowered)) as pool:
        return list(pool.map(compile_one, lowered))
