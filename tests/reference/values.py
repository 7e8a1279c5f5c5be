"""Values of wedges: how far from a guess, similar triangles, and surfaces fitted to the values around a vertex.
docs/format: Far values; Fitted values."""

from arithmetic import ZERO, bits, cross, cut, cut_to, div, dot, half, length, require, root, unit, wrap64
from densities import Density
from range_coder import Models
from splits import CLOSED


class Far:
    """Models of far values of a layer."""

    def __init__(self, numbers):
        self.numbers = numbers
        self.densities = [[Density("F_%d.%d" % (kind, i)) for i in range(numbers)] for kind in range(4)]
        self.means = [[16384] * numbers for _ in range(4)]
        self.recent = (0,) * numbers

    def decode(self, rc, kind, guess):
        value = []
        for i in range(self.numbers):
            f = self.means[kind][i]
            d = self.densities[kind][i].decode(rc, 0, min(max(f * 5 // 4 + 40, 72), 1 << 32))
            self.means[kind][i] = f + ((256 * min(abs(d), 1 << 26) - f) >> 4)
            value.append(guess[i] + d)
        self.recent = checked(value)
        return self.recent


def checked(value):
    require(all(abs(x) <= 1 << 26 for x in value), "a value is too large")
    return tuple(value)


def similar(A, B, left, r, delta):
    """The value at the apex of a triangle like the one of positions."""
    e = tuple(-2 * d for d in delta)
    f = tuple(2 * r[k] - delta[k] for k in range(3))
    E = max(dot(e, e), 1)
    alpha = div(dot(f, e) << 12, E)
    c = cross(e, f)
    k = max(bits(max(abs(x) for x in c)) - 24, 0)
    c = tuple(x >> k for x in c)
    beta = div(root(dot(c, c) << 8) << (k + 8), E)
    alpha, beta = cut_to(alpha, 1 << 20), min(beta, 1 << 20)
    D = [b - a for a, b in zip(A, B)]
    turned = [0] * len(A)
    if len(A) == 2:
        turned = [-D[1], D[0]] if left else [D[1], -D[0]]
    return tuple(cut_to(a + (d * alpha + t * beta >> 12), 1 << 26) for a, d, t in zip(A, D, turned))


class Fitted:
    """Models of fitted values of a layer."""

    def __init__(self, numbers):
        self.still = Models("still", 60000)
        self.numbers = [FittedNumber(i) for i in range(numbers)]


class FittedNumber:
    def __init__(self, i):
        self.pairs, self.overall = {}, [1500]
        self.S, self.T = {}, {}
        self.G, self.H = 0, 65536
        self.densities = [Density("pair_%d.%d" % (i, c)) for c in range(3)]
        self.reach_pairs, self.reach_overall = {}, [3000]
        self.reach_density = Density("reach_%d" % i)


class Frame:
    """How values lie around a split, in the plane along its vector."""

    def __init__(self, around, delta):
        self.around, self.delta = around, delta
        self.mean = around.mean
        n = around.normal
        lift = dot(delta, n) >> 14
        flat = tuple((delta[k] << 8) - (lift * n[k] >> 6) for k in range(3))
        self.along = unit(flat)
        if self.along == ZERO:
            e = (1 << 14, 0, 0) if abs(n[0]) < abs(n[1]) else (0, 1 << 14, 0)
            self.along = unit(cross(n, e))
        self.across = tuple(c >> 14 for c in cross(n, self.along))
        self.inverse = (1 << 40) // self.mean
        if all(abs(c) <= (1 << 26) - 1 for c in flat):
            span = length(flat) >> 8
        else:
            span = length(tuple(c >> 8 for c in flat))
        span = min(span, 32 * self.mean)
        self.apart = span * self.inverse >> 28
        self.wide = sum(b < 16 * span // self.mean for b in (11, 19, 27))

    def place(self, r):
        x, y = (
            cut_to(dot(r, axis) >> 6, 32 * self.mean) * self.inverse + (1 << 31) >> 32
            for axis in (self.along, self.across)
        )
        return x, y


def terms(x, y):
    """t_0 … t_4"""
    return [y, x * x >> 8, x * y >> 8, y * y >> 8, x]


def moments(places):
    """The matrix, as the text states it: which factors are rounded matters."""
    x, y = [p[0] for p in places], [p[1] for p in places]
    a, b, c = ([p[i] * p[j] >> 8 for p in places] for i, j in ((0, 0), (0, 1), (1, 1)))

    def total(*factors):
        return sum(p * q for p, q in zip(*factors))

    m20, m11, m02 = total(x, x), total(x, y), total(y, y)
    m30, m21, m12, m03 = total(x, a), total(y, a), total(x, c), total(y, c)
    m40, m31, m22, m13, m04 = total(a, a), total(a, b), total(a, c), total(b, c), total(c, c)
    lower = [[m02], [m21, m40], [m12, m31, m22], [m03, m22, m13, m04], [m11, m30, m21, m12, m20]]
    return [row + [0] * (5 - len(row)) for row in lower]


class Fit:
    """A surface of the second order through the values around a group, for each number."""

    def __init__(self, frame, layer_corners, layer_values, group, spoke_groups, own):
        around = frame.around
        level = around.level
        whole = around.kind == CLOSED and all(g == group for g in spoke_groups)
        samples = []
        for i, e in enumerate(around.spokes):
            if spoke_groups[i] != group or (not whole and i >= 64):
                continue
            element = level.elements[e]
            neighbours = [around.next[i]]
            if not whole and len(element) > 2:
                neighbours.append(around.previous[i])
            for r in neighbours:
                value = layer_values[layer_corners[e][element.index(r)]]
                u = [cut_to(a - b, 1 << 21) for a, b in zip(value, own)]
                samples.append((frame.place(around.relative(r)), u))
        N = len(samples)
        t = [terms(x, y) for (x, y), _ in samples]
        M = moments([place for place, _ in samples])
        for i in range(5):
            M[i][i] += (64 if i in (0, 4) else 2048) * (N + 1)
        inverse, L = [], [[0] * 5 for _ in range(5)]
        for p in range(5):
            inverse.append((1 << 62) // max(M[p][p], 1))
            for i in range(p + 1, 5):
                L[i][p] = wrap64(M[i][p] * inverse[p] >> 46)
            column = [M[j][p] for j in range(5)]
            for i in range(p + 1, 5):
                for j in range(p + 1, i + 1):
                    M[i][j] = wrap64(M[i][j] - (L[i][p] * column[j] >> 16))
        self.still = True
        self.slope, self.weights, self.rough, self.size = [], [], [], []
        for number in range(len(own)):
            u = [sample[1][number] for sample in samples]
            v = [sum(t[s][i] * u[s] for s in range(N)) for i in range(5)]
            rest = sum(x * x for x in u)
            self.still = self.still and rest == 0
            w = []
            for p in range(5):
                w.append(wrap64(v[p] * inverse[p] >> 46))
                rest = wrap64(rest - (w[p] * v[p] >> 16))
                for i in range(p + 1, 5):
                    v[i] = wrap64(v[i] - (L[i][p] * v[p] >> 16))
            self.slope.append(w[4])
            for p in range(4, -1, -1):
                for i in range(p + 1, 5):
                    w[p] = wrap64(w[p] - (L[i][p] * w[i] >> 16))
            self.weights.append(w)
            rest = cut(rest, 0, 1 << 54)
            self.rough.append((root(rest // max(N, 1) << 8) << 4) + 64)
            self.size.append(min(half(self.rough[-1] >> 5), 47))


def spread_of(pair, overall, rough):
    seen = min(pair[1], 30)
    z = (pair[0] * seen + 4 * overall[0]) // (seen + 4)
    return min(max((z * rough >> 12) * 5 // 4 + 40, 72), 1 << 32)


def spread_learns(pair, overall, rough, e):
    z = min((abs(e) << 12) // rough, 1 << 20)
    pair[1] = min(pair[1] + 1, 60000)
    pair[0] += div(z - pair[0], min(pair[1], 80) + 1)
    overall[0] += (z - overall[0]) >> 6


def read_pair(rc, models, frame, fit):
    """The difference of the values of the two children of a group."""
    open_ = frame.around.open
    if fit.still and rc.bit(models.still, open_):
        return (0,) * len(fit.slope)
    before, difference = 0, []
    for i, number in enumerate(models.numbers):
        rough = fit.rough[i]
        full = cut_to(fit.slope[i] * frame.apart >> 12, 1 << 33)
        trust = 0 if abs(full) < 2 * rough else 1 if abs(full) < 8 * rough else 2
        pair = number.pairs.setdefault((fit.size[i], 2 * frame.wide + open_), [0, 0])
        spread = spread_of(pair, number.overall, rough)
        carried = before * div(number.G << 12, number.H) * max(spread >> 6, 1) >> 12
        S, T = number.S.get((open_, trust), 16128), number.T.get((open_, trust), 16384)
        m = (full * ((S << 12) // T) >> 12) + carried
        c = 0 if spread < 256 else 1 if spread < 1024 else 2
        d = number.densities[c].decode(rc, m, spread)
        e = cut_to(256 * d - m, 1 << 36)
        spread_learns(pair, number.overall, rough, e)
        scale = max(abs(full), rough)
        x, y = cut_to(div(d << 16, scale), 1 << 12), cut_to(div(full << 8, scale), 1 << 12)
        S += (x * y >> 4) - (S >> 8)
        T = max(T + (y * y >> 4) - (T >> 8), 256)
        number.S[open_, trust], number.T[open_, trust] = cut(S, 0, T + (T >> 2)), T
        now = cut_to(div((e + carried) << 6, spread), 512)
        G = number.G + (before * now >> 2) - (number.G >> 7)
        number.H = max(number.H + (before * before >> 2) - (number.H >> 7), 4096)
        number.G = cut_to(G, number.H)
        before = now
        difference.append(d)
    return tuple(difference)


def read_reach(rc, models, frame, fit, r, own):
    """The value at an apex at `r`, relative to the vertex that splits."""
    t = terms(*frame.place(r))
    value = []
    for i, number in enumerate(models.numbers):
        m = cut_to(sum(w * x for w, x in zip(fit.weights[i], t)) >> 8, 1 << 33)
        pair = number.reach_pairs.setdefault(fit.size[i], [0, 0])
        spread = spread_of(pair, number.reach_overall, fit.rough[i])
        d = number.reach_density.decode(rc, m, spread)
        spread_learns(pair, number.reach_overall, fit.rough[i], cut_to(256 * d - m, 1 << 36))
        value.append(own[i] + d)
    return checked(value)
