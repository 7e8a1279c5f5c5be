"""Levels, and how a batch of splits makes a level of the coarser one. docs/format: Levels."""

from arithmetic import ZERO, add, cross, div, dot, require, sub, unit
from attributes import AttributeState, halves, read_level0, read_split, wedge_number
from elements import read_elements
from points import read_points
from range_coder import Models
from splits import GROW12, GROW21, ONE, TWO, Around, Cuts, edge_length, flag_context, read_cut
from vectors import Vectors, read_vector


class Level:
    def __init__(self, shift, positions, elements, parents, labels, corners, values):
        self.shift, self.positions, self.elements, self.parents = shift, positions, elements, parents
        self.labels, self.corners, self.values = labels, corners, values
        self.stars = [[] for _ in positions]
        for e, element in enumerate(elements):
            for v in element:
                self.stars[v].append(e)

    def next(self, e, v):
        element = self.elements[e]
        return element[(element.index(v) + 1) % len(element)]

    def previous(self, e, v):
        element = self.elements[e]
        return element[element.index(v) - 1]

    def check(self, front, number):
        row = front.levels[number]
        require(len(self.positions) == row.vertices, "not the vertices that the level table says")
        require(len(self.elements) == row.elements, "not the elements that the level table says")
        require(sum(map(len, self.elements)) == row.corners, "not the corners that the level table says")
        most = (1 << 26) >> self.shift
        require(all(abs(c) <= most for p in self.positions for c in p), "a coordinate is too large")
        full = number + 1 == len(front.levels)
        for values, layer in zip(self.values, front.layers):
            require(len(values) <= layer.wedges, "too many wedges")
            require(not full or len(values) == layer.wedges, "too few wedges")


class State:
    """All that is learned and goes on through the file."""

    def __init__(self, front):
        self.alpha, self.m_alpha = 0, Models("alpha")
        self.births = Models("births", 20000)
        self.cuts, self.vectors, self.attributes = Cuts(), Vectors(), AttributeState(front)


def read_base(rc, front):
    """Level 0."""
    rc.mark("level 0")
    row = front.levels[0]
    rc.mark("points")
    positions = read_points(rc, row.vertices)
    rc.mark("elements")
    elements = read_elements(rc, positions, row.corners)
    level = Level(row.shift, positions, elements, [None] * len(positions), *read_level0(rc, front, elements))
    level.check(front, 0)
    return level


class Segment:
    """What a segment of a batch says."""

    def __init__(self):
        self.alpha, self.births, self.low, self.birth_low = None, [], [], []
        self.splits = []  # (v, cut, delta, inserted elements, local wedges of the spokes by layer, around)


def segment_range(n, segment, segments):
    return range(n * segment // segments, n * (segment + 1) // segments)


def segments_of(n):
    count = 1
    while count * 16384 < n:
        count *= 2
    return count


def read_segment(rc, front, state, level, l, segment, segments, batch):
    """A segment of the batch that leads to level `l`; the state learns."""
    rc.mark("level %d, segment %d of %d" % (l, segment, segments))
    result = Segment()
    if segment == 0:
        if rc.bit(state.m_alpha):
            state.alpha = rc.raw(8, "alpha")
        result.alpha = state.alpha
    vertices = segment_range(len(level.positions), segment, segments)
    bias = (len(front.levels) - 1 - l) % 2
    edges = edge_length(level)
    taken = set()  # elements of vertices that split
    left = front.levels[l].elements - front.levels[l - 1].elements
    for v in vertices:
        if any(e in taken for e in level.stars[v]):
            continue
        if not rc.bit(state.cuts.flag, flag_context(level, v, edges)):
            continue
        rc.mark("split of %d" % v)
        taken.update(level.stars[v])
        around = Around(level, v)
        cut = read_cut(rc, state.cuts, around)
        left -= cut.inserted()
        require(left >= 0, "too many elements are inserted")
        delta = read_vector(rc, state.vectors, around, cut)
        inserted, spokes = read_split(rc, state.attributes, batch, around, cut, delta, bias)
        result.splits.append((v, cut, delta, inserted, spokes, around))
    if segment == 0:
        rc.mark("births")
        count = rc.golomb(state.births)
        require(count <= front.levels[l].vertices - front.levels[l - 1].vertices, "too many births")
        result.births = read_points(rc, count)
    up = front.levels[l - 1].shift - front.levels[l].shift
    require(up <= 16, "a shift falls too far")
    if up > 0:
        rc.mark("low bits")
        for _ in range(len(vertices) + len(result.splits)):
            result.low.append(tuple(rc.raw(up, "low bits") for _ in range(3)))
        for _ in result.births:
            result.birth_low.append(tuple(rc.raw(up, "low bits") for _ in range(3)))
    return result


def refine(front, level, l, segments, batch):
    """Level `l`, of the coarser level and all segments of its batch."""
    alpha = segments[0].alpha
    births = segments[0].births
    splits = {split[0]: split for segment in segments for split in segment.splits}
    taken = set()
    for v in splits:
        require(not taken & set(level.stars[v]), "two vertices that split share an element")
        taken.update(level.stars[v])
    bias = (len(front.levels) - 1 - l) % 2

    # Vertices.
    number, positions, parents = [], [], []
    for v, p in enumerate(level.positions):
        number.append(len(positions))
        if v not in splits:
            positions.append(p)
            parents.append(v)
            continue
        delta = splits[v][2]
        o = compensation(level, v, alpha, taken)
        pair = [halves(p[k] - o[k], delta[k], bias) for k in range(3)]
        positions += [tuple(x[0] for x in pair), tuple(x[1] for x in pair)]
        parents += [v, v]
    positions += births
    parents += [None] * len(births)
    up = level.shift - front.levels[l].shift
    if up > 0:
        low = [bits for segment in segments for bits in segment.low] + segments[0].birth_low
        positions = [tuple((c << up) + b for c, b in zip(p, q)) for p, q in zip(positions, low)]

    # Elements, with their labels and wedges.
    split_of = {}  # old element: (split, number of its spoke)
    first_of = {}
    for v, split in splits.items():
        for i, e in enumerate(split[5].spokes):
            split_of[e] = (split, i)
        if level.stars[v]:
            first_of[level.stars[v][0]] = split
    layers = range(len(front.layers))
    elements, labels, corners = [], [], [[] for _ in layers]

    def insert(split):
        v1 = number[split[0]]
        for element in split[3]:
            if element.apex is None:
                elements.append((v1, v1 + 1))
            elif element.turned:
                elements.append((v1 + 1, v1, number[element.apex]))
            else:
                elements.append((v1, v1 + 1, number[element.apex]))
            labels.append(element.label)
            for layer in layers:
                wedges = element.wedges[layer]
                if wedges is not None:
                    wedges = [wedge_number(end) for end in wedges]
                    if element.turned:
                        wedges[:2] = wedges[1::-1]
                corners[layer].append(wedges)

    for e, element in enumerate(level.elements):
        if e in first_of:
            insert(first_of[e])
        split, spoke = split_of.get(e, (None, None))
        new, sources = [], []  # sources: (old corner, child or None)
        for i, w in enumerate(element):
            if split is None or w != split[0]:
                new.append(number[w])
                sources.append((i, None))
                continue
            children = {ONE: (0,), TWO: (1,), GROW12: (0, 1), GROW21: (1, 0)}[split[1].sides[spoke]]
            for child in children:
                new.append(number[w] + child)
                sources.append((i, child))
        elements.append(tuple(new))
        labels.append(level.labels[e])
        for layer in layers:
            old = level.corners[layer][e]
            if old is not None:
                old = [
                    old[i] if child is None else split[4][layer][spoke][child].wedge for i, child in sources
                ]
            corners[layer].append(old)
    for v in sorted(splits):
        if not level.stars[v]:
            insert(splits[v])

    values = []
    for layer in layers:
        of = list(level.values[layer])
        for wedge, value in batch.changed[layer].items():
            of[wedge] = value
        values.append(of + batch.appended[layer])
    finer = Level(front.levels[l].shift, positions, elements, parents, labels, corners, values)
    finer.check(front, l)
    return finer


def compensation(level, v, alpha, taken):
    """`taken`: the elements that name a vertex that splits."""
    if alpha == 0:
        return ZERO
    polygons = [e for e in level.stars[v] if len(level.elements[e]) >= 3]
    n = len(polygons)
    if not 3 <= n <= 64:
        return ZERO
    nexts = [level.next(e, v) for e in polygons]
    around = ZERO
    for r in nexts:
        around = add(around, level.positions[r])
    total, N = 0, ZERO
    for r in nexts:
        q, a = level.positions[r], ZERO
        if len(level.stars[r]) <= 64:
            for e in level.stars[r]:
                if 3 <= len(level.elements[e]) <= 64 and e not in taken:
                    x, y = level.positions[level.next(e, r)], level.positions[level.previous(e, r)]
                    a = add(a, cross(sub(x, q), sub(y, q)))
        u = unit(a)
        total += dot(sub(tuple(n * c for c in q), around), u)
        N = add(N, u)
    w = div(div(total, n * n) * alpha, 256)
    return tuple((w * c + (1 << 27)) >> 28 for c in unit(N))
