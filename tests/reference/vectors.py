"""The vector between the two children of a split. docs/format: Split vectors."""

from arithmetic import (
    ZERO, add, bits, cross, cut, cut_to, div, dot, half, length, require, root, saturate64, sub, unit,
)
from densities import Density
from splits import GROW12, GROW21, ONE


class Vectors:
    """What the coding of split vectors learns: part of the state."""

    def __init__(self):
        self.along, self.square = 11520, 25600
        self.overall = [12000, 12000, 5000]
        self.pairs = {}  # (a, size, shape): [mean, count]
        self.densities = [[Density("code_%s.%d" % (axis, c)) for c in range(3)] for axis in "xyz"]


def scale(v, factor, shift):
    return tuple(c * factor >> shift for c in v)


def across(n):
    """A vector across n."""
    x, y, z = (abs(c) for c in n)
    e = (1 << 14, 0, 0) if x <= min(y, z) else (0, 1 << 14, 0) if y <= z else (0, 0, 1 << 14)
    return unit(cross(n, e))


def read_vector(rc, state, around, cut_):
    sums, counts = [ZERO, ZERO], [0, 0]
    for i, side in enumerate(cut_.sides):
        for x, first in ((around.previous[i], (ONE, GROW12)), (around.next[i], (ONE, GROW21))):
            child = 0 if side in first else 1
            sums[child] = add(sums[child], around.relative(x))
            counts[child] += 1
    for apex, _ in cut_.triangles:
        for child in (0, 1):
            sums[child] = add(sums[child], around.relative(apex))
            counts[child] += 1
    gap = tuple(
        div(256 * sums[0][k], max(counts[0], 1)) - div(256 * sums[1][k], max(counts[1], 1)) for k in range(3)
    )

    # Frame.
    mean = around.mean
    n = around.normal
    if n == ZERO:
        n = across(unit(gap))
    if n == ZERO:
        n = (0, 0, 1 << 14)
    lift = dot(gap, n) >> 14
    flat = sub(gap, scale(n, lift, 14))
    t = unit(flat)
    if t == ZERO:
        t = across(n)
    l = tuple(c >> 14 for c in cross(n, t))
    reach = max(length(tuple(div(c, 256) for c in flat)), 1)
    mu = scale(flat, div(state.along << 12, max(state.square, 1)), 12)

    # Spreads.
    size = min(half(mean >> 5), 39)
    wide = sum(b < 16 * reach // mean for b in (11, 19, 27))
    shapes = [wide + 4 * around.flatness] * 2 + [4 * around.flatness + around.open]
    pairs = [state.pairs.setdefault((a, size, shapes[a]), [0, 0]) for a in range(3)]
    spreads = []
    for a, (average, seen) in enumerate(pairs):
        seen = min(seen, 30)
        average = (average * seen + 4 * state.overall[a]) // (seen + 4)
        spreads.append(min(div((average * mean >> 16) * 5, 4) + 40, 1 << 26))

    # Covariance.
    drop = max(bits(max(spreads)) - 20, 0)
    axes = [scale(vector, spreads[a] >> drop, 12) for a, vector in enumerate((t, l, n))]

    def sigma(i, j):
        return sum(axis[i] * axis[j] for axis in axes) >> 4

    def deviation(x):
        return root(max(x, 0)) << drop

    def code(axis, m, s):
        c = 0 if max(s, 72) < 256 else 1 if s < 1024 else 2
        return state.densities[axis][c].decode(rc, m, s)

    xx = max(sigma(0, 0), 1)
    xy, xz = sigma(0, 1), sigma(0, 2)
    dx = code(0, mu[0], deviation(xx))
    ex = cut_to(256 * dx - mu[0], 1 << 34)
    sy, sz = (cut_to(div(s << 12, xx), 1 << 24) for s in (xy, xz))
    yy = max(sigma(1, 1) - (saturate64(sy * xy) >> 12), 1)
    yz = sigma(1, 2) - (saturate64(sy * xz) >> 12)
    dy = code(1, mu[1] + (sy * ex >> 12), deviation(yy))
    ey = cut_to(256 * dy - mu[1] - (sy * ex >> 12), 1 << 34)
    s = cut_to(div(yz << 12, yy), 1 << 24)
    zz = max(sigma(2, 2) - (saturate64(sz * xz) >> 12) - (saturate64(s * yz) >> 12), 1)
    dz = code(2, mu[2] + (sz * ex >> 12) + (s * ey >> 12), deviation(zz))
    delta = (dx, dy, dz)
    require(all(abs(d) <= 1 << 27 for d in delta), "a split vector is too long")

    # Learning.
    e = tuple(cut_to(256 * delta[k] - mu[k], 1 << 36) for k in range(3))
    for a, vector in enumerate((t, l, n)):
        z = min((abs(dot(e, vector) >> 14) << 16) // mean, 1 << 19)
        pair = pairs[a]
        pair[1] += 1
        pair[0] += div(z - pair[0], min(pair[1], 80) + 1)
        state.overall[a] += (z - state.overall[a]) >> 6
    if reach < 1 << 24:
        c = cut_to(dot(delta, t), 1 << 40)
        x = cut_to(div(256 * (c >> 6), mean), 1 << 16)
        y = cut_to(256 * reach // mean, 1 << 16)
        state.along += (x * y >> 6) - (state.along >> 8)
        state.square += (y * y >> 6) - (state.square >> 8)
        state.along = cut(state.along, 0, state.square)
    return delta
