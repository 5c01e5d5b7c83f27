"""Attitudes in which a target looks alike: which of them pictures speak for, and the turn from one to another.

A finder of landmarks takes some pictures for those of another attitude in which the target looks the same. The filter
holds one of the attitudes, and each picture, whatever names it gives to the landmarks, tells that one as well; what its
names say is a vote for one of them. Votes are counted, old ones less, and the attitude is certain once one alternative
has so many more votes than any other that a tie does not explain it.
"""

import jax
import jax.numpy as jnp
from jax.scipy.special import xlogy
from jaxtyping import Array, Bool, Float, Int

from rpojax.core import quaternion
from rpojax.core.pytree import pytree

MARGIN = 10.0
"""Log-likelihood ratio of more votes for an alternative than for any other, over a tie, from which it is certain: e^-10
is 5e-5."""
MEMORY = 400.0
"""Pictures after which the weight of a vote has fallen to 1/e. With half of them a finder that is wrong in 30 % of the
pictures leaves the attitude uncertain now and then; with more a change of mind takes longer."""


@pytree
class BodySymmetries:
    """Turns of the target about its origin, with shifts, after which it looks as before; the first is none.

    Attributes:
        turns: (s, 4) unit quaternions
        shifts: (s, 3) in T [m]
        permutations: (s, n) int32, landmark that is where each is after the turn
        products: (s, s) int32, number of the turn by the second after that by the first: `turns[a] turns[b]`
    """

    turns: Array
    shifts: Array
    permutations: Array
    products: Array


def of_body(
    turns: Float[Array, "s 4"], shifts: Float[Array, "s 3"], permutations: Int[Array, "s n"]
) -> BodySymmetries | None:
    """Symmetries of a file of landmarks, None of a body that looks alike in no other attitude."""
    if turns.shape[0] == 1:
        return None
    multiplied = jax.vmap(jax.vmap(quaternion.multiply, (None, 0)), (0, None))(turns, turns)
    likeness = jnp.abs(jnp.sum(multiplied[:, :, None] * turns[None, None], axis=3))
    products = jnp.argmax(likeness, axis=2).astype(jnp.int32)
    return BodySymmetries(turns=turns, shifts=shifts, permutations=permutations, products=products)


def begun(votes: Float[Array, " s"] | None, found: Bool[Array, ""]) -> Float[Array, " s"] | None:
    """Votes where an attitude was `found`: that of its picture, for it; None of a body without symmetries."""
    return None if votes is None else jnp.where(found, jnp.zeros_like(votes).at[0].set(1.0), votes)


def voted(votes: Float[Array, " s"], shares: Float[Array, " s"], counts: Bool[Array, ""]) -> Float[Array, " s"]:
    """Votes after a picture that speaks for each alternative by its share, if it `counts`."""
    return jnp.where(counts, (1.0 - 1.0 / MEMORY) * votes + shares, votes)


def leads(votes: Float[Array, " s"]) -> Float[Array, " s"]:
    """Log-likelihood ratio of each alternative being voted for more often than any other, over a tie; 0 if it is not.

    Of a and b votes it is that of the shares a / (a + b) and b / (a + b) over one half each.
    """
    numbers = jnp.arange(votes.shape[0])
    others = jnp.where(numbers[:, None] == numbers[None, :], 0.0, votes[None, :])
    second = jnp.max(others, axis=1)
    total = jnp.maximum(votes + second, 1e-30)
    ratio = xlogy(votes, 2.0 * votes / total) + xlogy(second, 2.0 * second / total)
    return jnp.where(votes > second, ratio, 0.0)


def is_certain(votes: Float[Array, " s"]) -> Bool[Array, ""]:
    """Whether the attitude that is held, the first alternative, is."""
    return leads(votes)[0] >= MARGIN


def better(votes: Float[Array, " s"]) -> tuple[Int[Array, ""], Bool[Array, ""]]:
    """Number of the best alternative, and whether it is certain and not the one that is held."""
    found = leads(votes)
    best = jnp.argmax(found, axis=0).astype(jnp.int32)
    return best, (best > 0) & (jnp.max(found, axis=0) >= MARGIN)


def seen_from(symmetries: BodySymmetries, votes: Float[Array, " s"], number: Int[Array, ""]) -> Float[Array, " s"]:
    """Votes in the order of the alternatives to that of a number."""
    return votes[symmetries.products[:, number]]
