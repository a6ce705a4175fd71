"""Flow through the gap and through the spots of a contact, from fields of a periodic cell. Knows no runs.

Memory and time of the flow solver are measured.
"""

from __future__ import annotations

import math

LARGEST_DIRECT = 1 << 20  # points of scipy's sparse factors; larger grids use pyamg where it is installed
FIELDS = 60  # arrays of the grid beside the factors
ENTRY = 45  # bytes of an entry of the factors, with the fill while they are made


def flow_memory(points: int) -> float:
    """Return the bytes of a flow through an open gap; with contact it is less."""
    # The factors of a five-point matrix have 6 log2(n) - 17 entries a point on n x n points, measured from
    # 256 x 256 to 1024 x 1024.
    entries = max(3 * math.log2(points) - 17, 6) if points <= LARGEST_DIRECT else 0
    return 8 * points * FIELDS + ENTRY * entries * points
