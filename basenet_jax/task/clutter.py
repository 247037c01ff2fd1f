"""Objects in each other's way: what can be picked while what still stands, and what no order of picks can have.

Sets of objects are bits of 32-bit words, so that asking whether any of many ways is open costs one `and` for each.
What was picked stays gone: so whatever can be picked now can be picked later, and picking all that can be, again and
again, ends with the most objects that any order can have.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Bool, Float, UInt32

from basenet_jax import struct

_WORD = 32


@struct.dataclass
class Clutter:
    """In which ways K stops serve M objects, and what must be gone for each."""

    time: Float[Array, "*batch K M A"]  # s; infinite: no such way
    blockers: UInt32[Array, "*batch K M A W"]  # the objects that must be gone, as bits; see `as_bits`

    def times_among(self, standing: Bool[ArrayLike, "*batch M"], numpy: Any = jnp) -> Float[Array, "*batch K M"]:
        """Pick times (s) while these objects stand; infinite where none of the ways is open.

        Args:
            standing: may hold the object itself, which is never in its own way.
            numpy: the module that computes it: `jax.numpy`, or NumPy on the host.
        """
        words = as_bits(standing, numpy)[..., None, None, None, :]
        blocked = numpy.any((self.blockers & words) != 0, axis=-1)
        return numpy.min(numpy.where(blocked, numpy.inf, self.time), axis=-1)

    def without(self, standing: Bool[ArrayLike, "*batch M"], numpy: Any = jnp) -> "Clutter":
        """The ways that are open although these objects stay for ever."""
        words = as_bits(standing, numpy)[..., None, None, None, :]
        blocked = numpy.any((self.blockers & words) != 0, axis=-1)
        return Clutter(numpy.where(blocked, numpy.inf, self.time), self.blockers)

    def only(self, serves: Bool[ArrayLike, "*batch K M"], numpy: Any = jnp) -> "Clutter":
        """The ways of these pairs of stop and object alone."""
        return Clutter(numpy.where(numpy.asarray(serves)[..., None], self.time, numpy.inf), self.blockers)


def as_bits(members: Bool[ArrayLike, "*batch M"], numpy: Any = jnp) -> UInt32[Array, "*batch W"]:
    """A set of objects as bits: object `o` is bit `o % 32` of word `o // 32`."""
    flags: Any = numpy.asarray(members)
    count = flags.shape[-1]
    padded = numpy.pad(flags, [(0, 0)] * (flags.ndim - 1) + [(0, -count % _WORD)])
    words = padded.reshape(*flags.shape[:-1], -1, _WORD).astype(numpy.uint32)
    return numpy.sum(words << numpy.arange(_WORD, dtype=numpy.uint32), axis=-1, dtype=numpy.uint32)


def as_members(bits: UInt32[ArrayLike, "*batch W"], count: int) -> Bool[np.ndarray, "*batch M"]:
    """The set of M objects that some bits stand for, on the host."""
    words = np.asarray(bits)
    members = (words[..., None] >> np.arange(_WORD, dtype=np.uint32)) & 1
    return members.reshape(*words.shape[:-1], -1)[..., :count].astype(bool)


def obtainable(clutter: Clutter, reachable: Bool[ArrayLike, "*batch K"], numpy: Any = jnp) -> Bool[Array, "*batch M"]:
    """All objects that some order of picks can have.

    Args:
        clutter: the ways.
        reachable: which stops can be driven to.
        numpy: the module that computes it.
    """
    time = numpy.where(numpy.asarray(reachable)[..., None, None], clutter.time, numpy.inf)
    ways = Clutter(time, clutter.blockers)

    def grow(gone: Array) -> Array:
        return gone | numpy.any(numpy.isfinite(ways.times_among(~gone, numpy)), axis=-2)

    none = numpy.zeros(time.shape[:-3] + time.shape[-2:-1], bool)
    if numpy is np:
        gone, more = none, grow(none)
        while np.any(more != gone):
            gone, more = more, grow(more)
        return gone
    start = (none, grow(none))
    return jax.lax.while_loop(lambda s: jnp.any(s[0] != s[1]), lambda s: (s[1], grow(s[1])), start)[1]
