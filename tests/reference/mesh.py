"""What is handed out: positions and values in floating point. docs/format: The tables, "Lattice"; Levels; Values to
numbers."""

from math import sqrt


def place(front, level, v):
    """The position of a vertex, in the units of the model."""
    scale, middle = float(1 << level.shift), ((1 << level.shift) - 1) / 2.0
    q = level.positions[v]
    return [front.origin[k] + (q[k] * scale + middle) * front.step for k in range(3)]


def numbers(layer, value):
    """The components of a value of a layer."""
    if layer.linear:
        return [layer.origin[c] + q * layer.step for c, q in enumerate(value)]
    t = float((1 << layer.bits) - 1)
    more = [] if layer.components == 3 else [1.0 if value[2] > 0 else -1.0]
    if value[0] < 0 and value[1] < 0:
        return [0.0, 0.0, 0.0] + more
    x, y = (min(max(q, 0), t) / t * 2.0 - 1.0 for q in value[:2])
    z = 1.0 - abs(x) - abs(y)
    if z < 0:
        x, y = (1.0 - abs(y)) * (1.0 if x >= 0 else -1.0), (1.0 - abs(x)) * (1.0 if y >= 0 else -1.0)
    length = sqrt(x * x + y * y + z * z)
    return [x / length, y / length, z / length] + more
