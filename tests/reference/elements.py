"""The elements of level 0 and the elements aside. docs/format: Elements; Elements aside."""

from arithmetic import require
from range_coder import Models


class Gates:
    """Open gates a → b, by age, from a and to b."""

    def __init__(self):
        self.all = {}  # age: (a, b, before, after)
        self.starts, self.ends = {}, {}
        self.age = 0

    def open(self, a, b, before, after):
        self.all[self.age] = (a, b, before, after)
        self.starts.setdefault(a, []).append(self.age)
        self.ends.setdefault(b, []).append(self.age)
        self.age += 1

    def close(self, age):
        gate = self.all.pop(age)
        self.starts[gate[0]].remove(age)
        self.ends[gate[1]].remove(age)
        return gate

    def take_oldest(self):
        return self.close(next(iter(self.all))) if self.all else None

    def newest_from(self, a):
        """The newest 12 open gates from `a`, the newest first."""
        return self.starts.get(a, [])[:-13:-1]

    def newest_to(self, b):
        return self.ends.get(b, [])[:-13:-1]

    def in_gate(self, v):
        return bool(self.starts.get(v) or self.ends.get(v))

    def note(self, p, q, before, after):
        """The edge p → q of an element closes the newest gate q → p, or opens one."""
        age = next((age for age in self.newest_from(q) if self.all[age][1] == p), None)
        if age is None:
            self.open(p, q, before, after)
        else:
            self.close(age)

    def closing(self, first, last, final):
        """The class, left and right."""
        left = next((self.all[i][0] for i in self.newest_to(last) if self.all[i][0] != first), None)
        right = None
        if final:
            right = next((self.all[i][1] for i in self.newest_from(first) if self.all[i][1] != last), None)
        if left is None and right is None:
            return 0, left, right
        if left is None or right is None:
            return 1, left, right
        return (3 if left == right else 2), left, right


def read_elements(rc, positions, corners_declared):
    m_count, m_seed, m_degree = Models("count"), Models("seed"), Models("degree")
    m_behind, m_same, m_closes = Models("behind"), Models("same"), Models("closes")
    m_found, m_rank = Models("found"), Models("rank")
    n = len(positions)
    count = rc.golomb(m_count)
    require(2 * count <= corners_declared, "more elements than corners allow")
    if count == 0:
        return []
    grid = rc.uniform(27, "G")
    rows = {}
    for v, (x, y, z) in enumerate(positions):
        rows.setdefault((x >> grid, y >> grid), {}).setdefault(z >> grid, []).append(v)
    gates, elements, named, used = Gates(), [], set(), 0
    degree, behind, seed = 3, 1, 0
    while len(elements) < count:
        gate = gates.take_oldest()
        if gate:
            a, b, before, after = gate
            kind = gates.closing(b, a, True)[0]
            behind = rc.bit(m_behind, 2 * kind + behind)
            if not behind:
                continue
            element = [b, a]
        else:
            seed += rc.golomb(m_seed)
            require(seed < n, "a corner that is no vertex")
            element = [seed]
        least = 3 if gate else 2
        index = 1 if gate else 0
        if rc.bit(m_same, index):
            degree = max(degree, least)
        else:
            degree = rc.golomb(m_degree) + least
        used += degree
        require(degree <= n and used <= corners_declared, "too many corners")
        while len(element) < degree:
            k = len(element)
            p = [positions[v] for v in element]
            axes = range(3)
            if gate and degree == 3:
                pa, pb, q, r = (positions[v] for v in (a, b, before, after))
                place = [(2 * pa[i] + 2 * pb[i] - q[i] - r[i]) // 2 for i in axes]
            elif gate and k == 2:
                place = [2 * positions[a][i] - positions[before][i] for i in axes]
            elif degree == 3 and k == 2:
                place = [(p[0][i] + p[1][i]) // 2 for i in axes]
            elif k + 1 == degree and k >= 3:
                place = [p[k - 1][i] + p[0][i] - p[k - 2][i] for i in axes]
            else:
                place = p[k - 1]
            found = candidates(rows, grid, place, element, positions, named, gates)
            kind, left, right = gates.closing(element[0], element[-1], k + 1 == degree)
            corner = None
            for i, guess in enumerate((left, right)):
                if guess is None or guess in element or (i == 1 and guess == left):
                    continue
                rank = min(found.index(guess), 3) if guess in found else 4
                if rc.bit(m_closes, 2 * (5 * kind + rank) + i):
                    corner = guess
                    break
                if guess in found:
                    found.remove(guess)
            if corner is None and rc.bit(m_found, index):
                rank = rc.golomb(m_rank, index)
                corner = found[rank] if rank < len(found) else None
            if corner is None:
                corner = rc.uniform(n, "corner")
            require(corner not in element, "a corner is named twice")
            element.append(corner)
        if degree >= 3:
            for i in range(1 if gate else 0, degree):
                p, q = element[i], element[(i + 1) % degree]
                gates.note(p, q, element[i - 1], element[(i + 2) % degree])
        named.update(element)
        elements.append(tuple(element))
    return elements


def candidates(rows, grid, place, element, positions, named, gates):
    cx, cy, cz = (c >> grid for c in place)
    found = []
    for x in (cx - 1, cx, cx + 1):
        for y in (cy - 1, cy, cy + 1):
            row = rows.get((x, y), {})
            found += [v for z in (cz - 1, cz, cz + 1) for v in row.get(z, [])][:12]

    def key(v):
        finished = v in named and not gates.in_gate(v)
        return finished, sum((positions[v][i] - place[i]) ** 2 for i in range(3)), v

    return sorted((v for v in found if v not in element), key=key)


def read_aside(rc, vertices, counts):
    """The elements that repeat a vertex, over the vertices of the full level."""
    m_count, m_degree, m_first = Models("count"), Models("degree"), Models("first")
    m_repeat, m_down, m_distance = Models("repeat"), Models("down"), Models("distance")
    elements, first, used = [], 0, 0
    count = rc.golomb(m_count)
    require(count == counts[0], "not the elements aside that the tables say")
    for _ in range(count):
        degree = 2 + rc.golomb(m_degree)
        used += degree
        require(used <= counts[1], "more corners aside than declared")
        first += rc.golomb(m_first)
        element = [first]
        while len(element) < degree:
            for t in range(1, min(4, len(element)) + 1):
                if rc.bit(m_repeat, t):
                    corner = element[-t]
                    break
            else:
                down = rc.bit(m_down)
                distance = rc.golomb(m_distance)
                corner = element[-1] + (-distance if down else distance)
            element.append(corner)
        require(all(0 <= v < vertices for v in element), "a corner aside that is no vertex")
        elements.append(tuple(element))
    require(used == counts[1], "not the corners aside that the tables say")
    return elements
