"""Products and lengths of many vectors, by plain operations: the same bits on every machine."""

from __future__ import annotations

import numpy as np

from ariac_score.trial.spans import FloatArray

__all__ = ["dot", "lengths"]


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """The product of each vector with its partner.

    Written out, because numpy chooses the order of a sum over an axis; of two or three components it is
    faster, too.

    Args:
        a: Shape (..., k).
        b: Likewise.

    >>> dot(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[5.0, 6.0], [7.0, 8.0]])).tolist()
    [17.0, 53.0]
    """
    total: FloatArray = a[..., 0] * b[..., 0]
    for component in range(1, a.shape[-1]):
        total = total + a[..., component] * b[..., component]
    return total


def lengths(vectors: FloatArray) -> FloatArray:
    """The length of each vector, shape (...,) of (..., k).

    >>> lengths(np.array([[3.0, 4.0]])).tolist()
    [5.0]
    """
    found: FloatArray = np.sqrt(dot(vectors, vectors))
    return found
