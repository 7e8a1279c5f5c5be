"""Sets of integer points: a box, then halving or an octree. docs/format: Points."""

from math import isqrt

from arithmetic import bits, cut, cut_to, div

LIMIT = 1 << 25


def read_points(rc, n):
    """`n` points in lexicographic order."""
    if n == 0:
        return []
    low, size = read_box(rc)
    found = halving(rc, n, size) if n <= 24 else Octree(rc, n, size).points()
    return [tuple(low[k] + p[k] for k in range(3)) for p in sorted(found)]


def read_box(rc):
    exponent = rc.uniform(27, "B")
    negative = rc.uniform(2, "neg")
    h = min((1 << exponent) - 1, LIMIT)
    lo = max(-h - 1, -LIMIT) if negative else 0
    low, size = [], []
    for _ in range(3):
        w = h - lo + 1
        f, t = 0, w - 1
        if w > 1 and rc.uniform(2, "narrowed"):
            f = rc.uniform(w, "f")
            t = f + rc.uniform(w - f, "t")
        low.append(lo + f)
        size.append(t - f + 1)
    return low, size


# Up to 24 points: halving


def halving(rc, n, size):
    points, stack = [], [((0, 0, 0), tuple(size), n)]
    while stack:
        corner, sides, n = stack.pop()
        if n == 0:
            continue
        a = sides.index(max(sides))
        if n == 1 or sides[a] == 1:
            point = tuple(corner[k] + (rc.uniform(sides[k], "place") if sides[k] > 1 else 0) for k in range(3))
            points += [point] * n
            continue
        lower = sides[a] // 2
        upper = sides[a] - lower
        p = 1 << 60
        for _ in range(n):
            p = p * upper // sides[a]
        frequencies = []
        for k in range(n + 1):
            frequencies.append((p >> 36) + 1)
            p = p * (n - k) * lower // ((k + 1) * upper)
        low = rc.choose(frequencies, "lower")
        parts = [list(sides), list(sides)]
        parts[0][a], parts[1][a] = lower, upper
        behind = list(corner)
        behind[a] += lower
        stack.append((tuple(behind), tuple(parts[1]), n - low))
        stack.append((corner, tuple(parts[0]), low))
    return points


# Mixed decisions

Q = [
    22, 36, 60, 98, 162, 267, 439, 720, 1179, 1921, 3108, 4971, 7812, 11955, 17625, 24743, 32768, 40793, 47911, 53581,
    57724, 60565, 62428, 63615, 64357, 64816, 65097, 65269, 65374, 65438, 65476, 65500, 65514,
]


def squash(x):
    i, j = divmod(x + 2048, 128)
    return (Q[i] * (128 - j) + Q[i + 1] * j) >> 7


def stretches():
    table, x = [], -2047
    for k in range(4096):
        while x < 2047 and squash(x) < 16 * k + 8:
            x += 1
        table.append(x)
    return table


STRETCH = stretches()


class Mixer:
    def __init__(self, name):
        self.name = name
        self.tables = [{} for _ in range(8)]
        self.sets = {}

    def slot(self, k, context):
        return self.tables[k].setdefault(context, [1 << 21, 0])

    def refresh(self):
        for table in self.tables:
            for slot in table.values():
                slot[1] = min(slot[1], 30)

    def mix(self, rc, contexts, number):
        weights = self.sets.setdefault(number, [[19660] * 8, 0])
        w, m = weights
        slots = [self.slot(k, contexts[k]) for k in range(8)]
        x = [STRETCH[slot[0] >> 10] for slot in slots]
        q = squash(cut_to(sum(x[k] * w[k] for k in range(8)) >> 16, 2047))
        decision = rc.choose([q, 65536 - q], self.name) == 0
        e = 65536 - q if decision else -q
        r = 30 - m // 16 if m < 256 else 22
        weights[1] = m + 1
        for k in range(8):
            w[k] = cut_to(w[k] + (x[k] * e * r + (1 << 19) >> 20), 1 << 20)
        target = (1 << 22) - 1 if decision else 0
        for slot in slots:
            slot[0] += (target - slot[0]) * (655360 // (10 * slot[1] + 19)) >> 16
            slot[1] = min(slot[1] + 1, 80)
        return decision


# More than 24 points: octree

# Each split: its axis, and the sides that its part has on the axes before.
SPLITS = [(0, ())] + [(1, (x,)) for x in (0, 1)] + [(2, (x, y)) for x in (0, 1) for y in (0, 1)]
PLACES = [0, 1, 2, 4, 6, 9, 14, 22, 40, 90]
CLASSES = [2, 3, 4, 6, 10, 20, 60]
AROUND = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)]
FACES = [(-1, 0, 0), (0, -1, 0), (0, 0, -1), (0, 0, 1), (0, 1, 0), (1, 0, 0)]


def place_class(e):
    number = next((i for i, bound in enumerate(PLACES) if bound >= abs(e)), len(PLACES))
    return 10 - number if e < 0 else 10 + number


def block(split, side):
    """The subcells of one side of a split, relative to the cell's first."""
    axis, before = SPLITS[split]
    return [
        (x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)
        if (x, y, z)[: axis + 1] == before + (side,)
    ]


def near(split, side):
    """The subcells of the window outside the cell that share a face with that block, and that touch it."""
    face, touch = set(), set()
    for c in block(split, side):
        for d in AROUND:
            s = (c[0] + d[0], c[1] + d[1], c[2] + d[2])
            if all(x in (0, 1) for x in s):
                continue
            touch.add(s)
            if d in FACES:
                face.add(s)
    return face, touch


NEAR = [[near(split, side) for side in (0, 1)] for split in range(7)]


class Octree:
    def __init__(self, rc, n, size):
        self.rc, self.n, self.size = rc, n, size
        self.side, self.both, self.share = Mixer("side"), Mixer("both"), Mixer("share")
        self.hashes = 64
        while self.hashes < min(4 * n, 1 << 16):
            self.hashes *= 2

    def points(self):
        cells, links = [((0, 0, 0), self.n)], [[]]
        for plane in range(bits(max(self.size) - 1) - 1, -1, -1):
            self.rc.mark("plane %d" % plane)
            cells, links = self.refine(cells, links, plane)
        return [p for p, n in cells for _ in range(n)]

    def refine(self, cells, links, plane):
        self.side.refresh()
        self.both.refresh()
        number = {cell: i for i, (cell, _) in enumerate(cells)}
        children = []
        for i, (cell, n) in enumerate(cells):
            around = self.look_around(cell, i, number, children)
            linked = self.look_at_links(cell, i, links[i], cells, children)
            children.append(self.split_cell(cell, n, plane, around, linked))
        # The children in order, each with the nearest of its siblings and of the children of its parent's links.
        finer = sorted((child, n, i) for i, of in enumerate(children) for child, n in of)
        order = {child: k for k, (child, _, _) in enumerate(finer)}
        finer_links = []
        for child, _, i in finer:
            candidates = [c for j in [i] + links[i] for c, _ in children[j] if c != child]
            candidates.sort(key=lambda c: (sum((c[k] - child[k]) ** 2 for k in range(3)), order[c]))
            finer_links.append([order[c] for c in candidates[:8]])
        return [(child, n) for child, n, _ in finer], finer_links

    def look_around(self, cell, i, number, children):
        known, opened, faces, neighbours = set(), set(), 0, 0
        for d in AROUND:
            j = number.get((cell[0] + d[0], cell[1] + d[1], cell[2] + d[2]))
            if j is None:
                continue
            neighbours += 1
            if d in FACES:
                faces |= 1 << FACES.index(d)
            if j < i:
                subcells = [tuple(c[k] - 2 * cell[k] for k in range(3)) for c, _ in children[j]]
            else:
                subcells = [tuple(2 * d[k] + c[k] for k in range(3)) for c in block_of_all()]
            for s in subcells:
                if all(-1 <= x <= 2 for x in s):
                    (known if j < i else opened).add(s)
        return known, opened, faces, neighbours

    def look_at_links(self, cell, i, links, cells, children):
        places, votes = [], [[0, 0] for _ in range(3)]
        for j in links:
            other = cells[j][0]
            d = [16 * (other[k] - cell[k]) for k in range(3)]
            if j < i:
                c = len(children[j])
                for k in range(3):
                    h = sum(child[k] & 1 for child, _ in children[j])
                    d[k] += div(4 * (2 * h - c), c)
                    if other[k] == cell[k]:
                        votes[k][0] += h < c
                        votes[k][1] += h > 0
            places.append([cut_to(x, 1 << 14) for x in d])
        m = len(places)
        sums = [sum(d[k] for d in places) for k in range(3)]
        products = [
            [m * sum(d[a] * d[b] for d in places) - sums[a] * sums[b] for b in range(3)] for a in range(3)
        ]
        return m, sums, products, votes

    def expected(self, linked, axis, before):
        m, s, p, _ = linked
        if m < 2:
            return None
        a, u, v = axis, (axis + 1) % 3, (axis + 2) % 3
        uu, vv = p[u][u] + 8 * m * m, p[v][v] + 8 * m * m
        d = uu * vv - p[u][v] ** 2
        alpha = p[a][u] * vv - p[a][v] * p[u][v]
        beta = p[a][v] * uu - p[a][u] * p[u][v]
        z = max(bits(d) - 40, 0)
        d = max(d >> z, 1)
        alpha = div(cut_to(alpha >> z, 1 << 46) << 12, d)
        beta = div(cut_to(beta >> z, 1 << 46) << 12, d)
        middle = [0, 0, 0]
        for k, side in enumerate(before):
            middle[k] = 4 if side else -4
        e = s[a] + (alpha * (m * middle[u] - s[u]) + beta * (m * middle[v] - s[v]) >> 12)
        sigma = max(p[a][a] - (alpha * p[a][u] + beta * p[a][v] >> 12), 0)
        return div(cut_to(e, 1 << 50), m), div(cut_to(sigma, 1 << 50), m * m)

    def split_cell(self, cell, n, plane, around, linked):
        counts = {(): n}
        for split, (axis, before) in enumerate(SPLITS):
            n = counts[before]
            if n == 0:
                low = 0
            elif 2 * cell[axis] + 1 > (self.size[axis] - 1) >> plane:
                low = n
            else:
                low = self.low(n, cell, plane, split, around, linked)
            counts[before + (0,)], counts[before + (1,)] = low, n - low
        return [
            ((2 * cell[0] + x, 2 * cell[1] + y, 2 * cell[2] + z), counts[x, y, z])
            for x in (0, 1) for y in (0, 1) for z in (0, 1) if counts[x, y, z] > 0
        ]

    def low(self, n, cell, plane, split, around, linked):
        rc = self.rc
        axis, before = SPLITS[split]
        known, opened, faces, neighbours = around
        kf, of, kt, ot = ([0, 0] for _ in range(4))
        for i in (0, 1):
            face, touch = NEAR[split][i]
            kf[i], of[i], kt[i], ot[i] = len(known & face), len(opened & face), len(known & touch), len(opened & touch)
        o = [min((of[i] + 3) // 4, 2) for i in (0, 1)]
        u = [min((ot[i] + 3) // 4, 2) for i in (0, 1)]
        expected = self.expected(linked, axis, before)
        spread = min(bits(expected[1] // 2), 13) if expected else 0
        h = 0
        for v in (axis, plane, cell[axis]):
            h = (h ^ v) * 0x9E3779B1 % (1 << 32)
            h = (h << 15 | h >> 17) % (1 << 32)
        hashed = (h * 0x85EBCA6B % (1 << 32) >> 12) % self.hashes

        if n > 1:
            q = next((i for i, bound in enumerate(CLASSES) if n <= bound), len(CLASSES))
            k = sorted(min(x, 5) for x in kf)
            oo = sorted(o)
            contexts = [
                9 * (6 * (6 * q + k[1]) + k[0]) + 3 * oo[1] + oo[0],
                16 * (16 * q + min(len(known), 31) // 2) + min(neighbours, 15),
                27 * min(n, 31) + plane,
                64 * split + faces,
                1 + 8 * (14 * abs(place_class(expected[0]) - 10) + spread) + q if expected else 0,
                0,
                0,
                hashed,
            ]
            if self.both.mix(rc, contexts, q):
                return 1 + self.shared(n - 2)

        flip = (kf[1], of[1], kt[1], ot[1]) > (kf[0], of[0], kt[0], ot[0])
        f, g = int(flip), 1 - int(flip)
        if flip:
            faces = int("{:06b}".format(faces)[::-1], 2)
        a4 = a5 = 0
        if expected:
            e = -expected[0] if flip else expected[0]
            a4 = 1 + 3 * (14 * place_class(e) + spread) + axis
            y = 31 + cut(div(8 * e, isqrt(expected[1] + 4)), -31, 31)
            a5 = 1 + 4 * (4 * y + min(kf[f], 3)) + min(kf[g], 3)
        votes = linked[3][axis]
        contexts = [
            3 * (3 * (3 * (6 * min(kf[f], 5) + min(kf[g], 5)) + o[f]) + o[g]) + axis,
            3 * (9 * (8 * min(kt[f], 7) + min(kt[g], 7)) + 3 * u[f] + u[g]) + axis,
            64 * split + faces,
            7 * plane + split,
            a4,
            a5,
            3 * (5 * min(votes[f], 4) + min(votes[g], 4)) + axis,
            2 * hashed + f,
        ]
        t = int(self.side.slot(7, contexts[7])[1] > 2)
        decision = self.side.mix(rc, contexts, 2 * (8 * axis + min(neighbours, 7)) + t)
        return n if decision != flip else 0

    def shared(self, m):
        low, high, node = 0, m, 1
        while low < high:
            middle = (low + high) // 2
            if node < 64:
                contexts = [64 * min(bits(m + 1) - 1, 7) + node, 16 * m + min(node, 15) if m < 16 else 0] + [0] * 6
                b = int(self.share.mix(self.rc, contexts, 0))
            else:
                b = self.rc.uniform(2, "share")
            if b:
                low = middle + 1
            else:
                high = middle
            node = min(2 * node + b, 64)
        return low


def block_of_all():
    return [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
