"""Which vertices split, and how the elements around them are cut. docs/format: Splits."""

from arithmetic import ZERO, add, bits, cross, cut_to, div, dot, require, root, sub, unit
from range_coder import Models

ONE, TWO, GROW12, GROW21 = range(4)
CLOSED, OPEN, GENERAL = range(3)
LONG = (16, 21, 25, 29, 33, 38, 44, 52, 64)
NEAR = (21, 24, 26)
EXP = [round(32768 * 2 ** (-i / 64)) for i in range(64)]
MOST = 12 << 16


class Cuts:
    """What the coding of cuts learns: part of the state."""

    def __init__(self):
        self.flag = Models("flag", 14000)
        self.fast = Models("fast", {(0,): 60000, (1,): 50000})
        self.one = Models("one")
        self.faces = Models("faces", 6000)
        self.grow, self.side = Models("grow", 8000), Models("side")
        self.count, self.many = Models("count"), Models("many")
        self.turned, self.extra, self.more = Models("turned"), Models("extra"), Models("more")
        self.edge = [0, 0, 0, 26214, 19661, -19661, -52429, -26214, -3277, 9830, 6554, 6554]
        self.face = [131072, -163840, -98304, -65536, -65536, -65536]
        self.child = [-196608, -196608, -131072, 19661, 65536, 58982, 19661, -13107, -32768, -26214, -19661]
        self.child += [-13107, -13107, -13107]
        self.scalar = [-393216, -131072, -170394]
        self.border = [0]
        self.seen = 0


class Around:
    """A vertex of the coarser level: its star in order, its ring, its measures."""

    def __init__(self, level, v):
        self.level, self.v = level, v
        star = level.stars[v]
        self.star = star
        self.kind, self.spokes, self.ring = find_fan(level, v, star)
        positions, here = level.positions, level.positions[v]
        self.next = [level.next(e, v) for e in self.spokes]
        self.previous = [level.previous(e, v) for e in self.spokes]
        self.relative = lambda x: sub(positions[x], here)
        self.m, self.Q = star_size(level, v)
        q = self.Q // max(self.m, 1)
        self.mean = max(root(q << 16), 1) if q < 1 << 40 else max(root(q << 8) << 4, 1)
        normal = ZERO
        for x, y in list(zip(self.next, self.previous))[:64]:
            normal = add(normal, cross(self.relative(x), self.relative(y)))
        self.normal = unit(normal)
        some = self.ring[:64]
        height = sum(abs(dot(self.relative(r), self.normal)) >> 6 for r in some) // max(len(some), 1)
        self.flatness = min(bits(height * 256 // self.mean // 4), 5)
        self.open = 0 if self.kind == CLOSED else 1


def find_fan(level, v, star):
    """The kind, the elements in order and the ring."""
    nexts = {level.next(e, v): e for e in star}
    fan = 1 <= len(star) <= 48 and len(nexts) == len(star) and all(len(level.elements[e]) >= 3 for e in star)
    if fan:
        previous = {level.previous(e, v) for e in star}
        starts = [e for e in star if level.next(e, v) not in previous]
        order = [starts[0] if starts else star[0]]
        while len(order) < len(star):
            following = nexts.get(level.previous(order[-1], v))
            if following is None or following in order:
                break
            order.append(following)
        ring = [level.next(e, v) for e in order]
        last = level.previous(order[-1], v)
        if len(order) == len(star) and len(starts) <= 1:
            if last == ring[0]:
                return CLOSED, order, ring
            if last not in ring:
                return OPEN, order, ring + [last]
    ring = sorted({x for e in star for x in (level.next(e, v), level.previous(e, v))})
    return GENERAL, list(star), ring


def star_size(level, v):
    """`m` and `Q`."""
    m, Q = min(64, len(level.stars[v])), 0
    for e in level.stars[v][:m]:
        if len(level.elements[e]) <= 64:
            d = sub(level.positions[level.next(e, v)], level.positions[v])
            Q += dot(d, d)
    return m, Q


def edge_length(level):
    """`edges`."""
    some = level.elements[:: len(level.elements) // 4096 + 1]
    mean = 0
    if some:
        squares = 0
        for element in some:
            d = sub(level.positions[element[1]], level.positions[element[0]])
            squares += dot(d, d)
        mean = min(squares // len(some), 1 << 55)
    return max(root(mean << 8) << 4, 1)


def flag_context(level, v, edges):
    n = len(level.stars[v])
    if n == 0:
        return 480
    m, Q = star_size(level, v)
    long = sum((Q << 26) >= m * (b * edges) ** 2 for b in LONG)
    crowd = 0
    for e in level.stars[v][:16]:
        x = level.next(e, v) if len(level.elements[e]) <= 64 else v
        crowd += len(level.stars[x])
    near = sum(4 * crowd >= b * min(n, 16) for b in NEAR)
    return ((min(n, 12) - 1) * 10 + long) * 4 + near


class Cut:
    def __init__(self):
        self.sides, self.triangles, self.dangling = [], [], 0  # a triangle is (apex, reversed)

    def inserted(self):
        return len(self.triangles) + self.dangling


def read_cut(rc, cuts, around):
    if around.kind != GENERAL and rc.bit(cuts.fast, around.kind):
        return fast_road(rc, cuts, around)
    return general_road(rc, cuts, around)


def fast_road(rc, cuts, around):
    level, n, N = around.level, len(around.spokes), len(around.ring)
    degrees = [len(level.elements[e]) for e in around.spokes]
    single = around.kind == OPEN and rc.bit(cuts.one)
    triangles = sum(d == 3 for d in degrees)
    mix = 0 if triangles == n else 1 + min(4 * triangles // n, 3)
    k = 3 * mix + (0 if around.kind == CLOSED else 2 if single else 1)
    count = rc.bit(cuts.faces, k, 0)
    if count and not single:
        count = 1 + rc.bit(cuts.faces, k, 1)

    # Loci, by place: (table of weights, class, number of the scalar, len, D, score).
    ring = [around.relative(r) for r in around.ring]
    h = (1 << 32) // around.mean
    loci = {}
    for place in range(2 * N if around.kind == CLOSED else 2 * N - 1):
        i = place // 2
        if place % 2 == 0 and count < 2:
            R, table, c, scalar = ring[i], cuts.edge, min(len(level.stars[around.ring[i]]), 11), 0
        elif place % 2 == 1 and count > 0:
            R = tuple(div(x, 2) for x in add(ring[i], ring[(i + 1) % N]))
            table, c, scalar = cuts.face, min(degrees[i] - 3, 5), 1
        else:
            continue
        V = tuple(cut_to(x * h >> 16, 1 << 24) for x in R)
        size = root(dot(V, V))
        D = tuple(x * ((1 << 24) // max(size, 1)) >> 16 for x in V)
        len_ = min(size, 1023) - 256
        loci[place] = (table, c, scalar, len_, D, table[c] + (cuts.scalar[scalar] * len_ >> 8))

    places = sorted(loci)
    if single:
        candidates = [(p, None) for p in places if p % 2 == count]
    else:
        candidates = [(p, q) for p in places for q in places if p < q and p % 2 + q % 2 == count]
    require(candidates, "a split without candidates")
    both = N + 1 - count if single else N + 2 - count
    children, scores, cosines, rims = [], [], [], []
    for p, q in candidates:
        n1 = (N if single else q // 2 + 1) - (p + 1) // 2
        score = loci[p][5] + cuts.child[min(n1, 13)] + cuts.child[min(both - n1, 13)]
        cos, rim = 0, False
        if not single:
            cos = dot(loci[p][4], loci[q][4]) >> 8
            score += loci[q][5] + (cuts.scalar[2] * cos >> 8)
            rim = around.kind == OPEN and (p == 0 or q == 2 * (N - 1))
            score += cuts.border[0] if rim else 0
        children.append(n1), scores.append(score), cosines.append(cos), rims.append(rim)
    best = max(scores)
    frequencies = []
    for score in scores:
        d = (best - score) >> 10
        frequencies.append(max(EXP[d % 64] >> min(d // 64, 31), 1))
    chosen = rc.choose(frequencies, "candidate")

    # Learning.
    cuts.seen += 1
    rate = 5 if cuts.seen <= 256 else 6 if cuts.seen <= 2048 else 7
    h = (1 << 40) // sum(frequencies)
    mass, counts, bend, rim = dict.fromkeys(loci, 0), {}, 0, 0
    for i, (p, q) in enumerate(candidates):
        g = -(frequencies[i] * h >> 24) + (65536 if i == chosen else 0)
        mass[p] += g
        if q is not None:
            mass[q] += g
            bend += g * cosines[i] >> 8
        counts[children[i]] = counts.get(children[i], 0) + g
        rim += g if rims[i] else 0

    def gain(table, i, x):
        table[i] = cut_to(table[i] + x, MOST)

    for place in places:
        table, c, scalar, len_, _, _ = loci[place]
        gain(table, c, mass[place] >> rate)
        gain(cuts.scalar, scalar, (mass[place] * len_ >> 8) >> rate)
    for n1 in range(both + 1):
        gain(cuts.child, min(n1, 13), counts.get(n1, 0) >> rate)
        gain(cuts.child, min(both - n1, 13), counts.get(n1, 0) >> rate)
    gain(cuts.scalar, 2, bend >> rate)
    gain(cuts.border, 0, rim >> rate)

    # The cut.
    p, q = candidates[chosen]
    result = Cut()
    for i in range(n):
        place = 2 * i + 1
        if place == p:
            side = GROW12
        elif place == q:
            side = GROW21
        elif single:
            side = ONE if place > p else TWO
        else:
            side = ONE if p < place < q else TWO
        result.sides.append(side)
    if p % 2 == 0:
        result.triangles.append((around.ring[p // 2], False))
    if q is not None and q % 2 == 0:
        result.triangles.append((around.ring[q // 2], True))
    return result


def general_road(rc, cuts, around):
    level, result = around.level, Cut()
    held = {x: [0, 0, 0] for x in around.ring}  # one + 2 · two, k, expected
    grown = False
    for i, e in enumerate(around.spokes):
        dangling = len(level.elements[e]) == 2
        before, behind = around.previous[i], around.next[i]
        a, b = held[behind][0], held[before][0]
        grows = rc.bit(cuts.grow, 2 * (4 * min(a, b) + max(a, b)) + dangling)
        second = 0
        if i > 0 or (dangling and grows):
            second = rc.bit(cuts.side, 2 * (4 * a + b) + grows)
        side = 2 * grows + second
        result.sides.append(side)
        grown = grown or bool(grows)
        for x, first, expected in ((before, (ONE, GROW12), (2, 1)), (behind, (ONE, GROW21), (1, 2))):
            child = 0 if side in first else 1
            held[x][0] |= 1 << child
            held[x][1] += 1
            if not dangling:
                held[x][2] |= expected[child]
    for x in around.ring:
        h, k, expected = held[x]
        c, t = 4 * h + min(k, 4) - 1, 0
        while t < 3 and rc.bit(cuts.count, c, t):
            t += 1
        if t == 3:
            t += rc.golomb(cuts.many)
        for _ in range(t):
            result.triangles.append((x, bool(rc.bit(cuts.turned, expected))))
    if (not grown and not result.triangles) or rc.bit(cuts.extra):
        result.dangling = 1 + rc.golomb(cuts.more)
    return result
