"""The front of a file, its tables, and the rules of the chunk table. docs/format: Container."""

import struct
import zlib
from types import SimpleNamespace

from arithmetic import bits, cut, leb128, require
from range_coder import Models, RangeDecoder

MAGIC = bytes.fromhex("8C4C4F44530D0A0A")
OFTEN, SELDOM = 60000, 5535
MOST = (1 << 32) - 2
BASE, LEVELS, SEGMENT, ASIDE, LONE, APPEARANCE, IMAGE, RECIPE = range(8)
SOURCE, PREVIEW = 128, 129
KINDS = {
    BASE: "base", LEVELS: "levels", SEGMENT: "segment", ASIDE: "aside", LONE: "lone", APPEARANCE: "appearance",
    IMAGE: "image", RECIPE: "recipe", SOURCE: "source", PREVIEW: "preview",
}


class Tables:
    """The stream of the tables, with its three more ways to code a number."""

    def __init__(self, data, trace):
        self.rc = RangeDecoder(data, trace)

    @staticmethod
    def number_models(name):
        return Models(name + ".z"), Models(name + ".l"), Models(name + ".t")

    @staticmethod
    def difference_models(name, z=32768, g=32768):
        return Models(name + ".z", z), Models(name + ".g", g), Models(name + ".m")

    def number(self, models, most=MOST):
        z, l, t = models
        if self.rc.bit(z):
            return 0
        node = 1
        for _ in range(6):
            node = 2 * node + self.rc.bit(l, node)
        n = node - 64
        value = 1
        if n > 0:
            value = (1 << n) + (self.rc.bit(t, n) << (n - 1))
            value += self.rc.raw(n - 1, t.name)
        require(value <= most, "a number of the tables is too large")
        return value

    def difference(self, models, s=0):
        z, g, m = models
        if self.rc.bit(z):
            return 0
        negative = self.rc.bit(g)
        size = self.rc.golomb(m) << s
        size += self.rc.raw(s, m.name) + 1
        return -size if negative else size

    def float(self, name):
        d = self.rc.uniform(17, name)
        number = self.rc.raw(4 * d, name) << (64 - 4 * d)
        return struct.unpack(">d", struct.pack(">Q", number))[0]


def finite(x):
    return x - x == 0


def read_front(data, trace=None):
    """What the front says, and the payloads of the chunks."""
    require(data[:8] == MAGIC, "this is no .lods file")
    require(len(data) > 8 and data[8] == 1, "a version that is not 1")
    size, place = leb128(data, 9)
    require(size <= 1 << 26, "the body is too long")
    body, end = data[place : place + size], place + size
    require(len(data) >= end + 4, "the front is cut")
    require(zlib.crc32(data[:end]) == int.from_bytes(data[end : end + 4], "little"), "checksum of the front")
    required, place = leb128(body, 0)
    require(required == 0, "a required feature that is not known")
    _, place = leb128(body, place)
    count, place = leb128(body, place)
    require(place + 4 * count <= len(body), "the body is cut")
    sums = [int.from_bytes(body[place + 4 * i : place + 4 * i + 4], "little") for i in range(count)]
    if trace:
        trace.begin("tables")
    front = read_tables(body[place + 4 * count :], count, trace)
    if trace:
        trace.end()
    check_order(front)
    place = end + 4
    for chunk, crc in zip(front.chunks, sums):
        require(len(data) >= place + chunk.size, "a payload is cut")
        chunk.payload = data[place : place + chunk.size]
        require(zlib.crc32(chunk.payload) == crc, "checksum of a chunk")
        place += chunk.size
    require(place == len(data), "bytes behind the last payload")
    return front


def read_tables(data, count, trace):
    tables = Tables(data, trace)
    rc = tables.rc
    A = tables.number_models("A")
    front = SimpleNamespace()

    rc.mark("lattice")
    front.step = tables.float("step")
    front.origin = [tables.float("origin") for _ in range(3)]
    front.position_bits = rc.uniform(22, "position bits")
    require(finite(front.step) and front.step > 0 and all(map(finite, front.origin)), "the lattice is not finite")

    rc.mark("counts aside")
    front.aside = (tables.number(A), tables.number(A))
    read_level_table(tables, A, front)
    full = front.levels[-1]

    rc.mark("components")
    front.components = full.vertices - tables.number(A)
    require(front.components >= 0, "fewer than no components")

    front.bounds = None
    if full.vertices > 0:
        rc.mark("bounds")
        M, low = tables.number_models("M"), []
        for _ in range(3):
            u = tables.number(M)
            low.append(u // 2 if u % 2 == 0 else -((u + 1) // 2))
        n = rc.uniform(33, "n")
        front.bounds = (low, [c + rc.raw(n, "hi") for c in low])
        require(all(abs(c) <= 1 << 24 for side in front.bounds for c in side), "bounds out of range")

    read_attribute_tables(tables, A, front)
    read_chunk_table(tables, count, front)
    return front


def read_level_table(tables, A, front):
    rc = tables.rc
    rc.mark("level table")
    L = tables.number(A)
    require(1 <= L <= 65536, "the number of levels")
    by_triangles = rc.bit(Models("by triangles"))
    V = tables.difference_models("V", z=SELDOM)
    E = tables.difference_models("E", z=OFTEN)
    C = tables.difference_models("C", z=OFTEN)
    X = tables.difference_models("X", z=SELDOM, g=OFTEN)
    S = Models("S", {(0,): SELDOM})

    def guess(x):
        return cut(x, 0, MOST)

    v, e, c = [tables.number(A)], [tables.number(A)], [tables.number(A)]
    s, x = [rc.raw(5, "s_0")], [rc.raw(10, "x_0")]
    for l in range(1, L):
        w = max(l - 4, 0)
        before = v[l - 1]
        if l >= 2:
            a, b, sum_before = before - v[w], e[l - 1] - e[w], sum(v[w : l - 1])
        else:
            a, b, sum_before = v[0], 2 * v[0], 4 * v[0]
        g = guess(before + (a * before // sum_before if sum_before else 0))
        v.append(g + tables.difference(V, max(bits(g - before) - 3, 0)))
        dv = v[l] - before
        g = guess(e[l - 1] + (dv * b // a if a > 0 else 2 * dv))
        e.append(g + tables.difference(E))
        de = e[l] - e[l - 1]
        g = guess(c[l - 1] + (3 * de if by_triangles else 2 * dv + 2 * de))
        c.append(g + tables.difference(C))
        s.append(s[l - 1] - rc.golomb(S))
        x.append(x[l - 1] + tables.difference(X))
        require(v[l] >= before and e[l] >= e[l - 1] and c[l] >= c[l - 1] and s[l] >= 0, "a level that shrinks")
        require(max(v[l], e[l], c[l]) <= MOST and 0 <= x[l] <= 1023, "a number of a level out of range")
    require(s[-1] == 0 and s[0] <= 24, "a shift out of range")
    for vertices, elements, corners in list(zip(v, e, c)) + [(v[-1] + 2,) + front.aside]:
        require(corners >= 2 * elements and (elements > 0 or corners == 0), "elements and corners do not agree")
        require(elements == 0 or vertices >= 2, "elements without vertices")
    require(front.aside[0] == 0 or v[-1] > 0, "elements aside without vertices")
    require(e[-1] + front.aside[0] <= MOST and c[-1] + front.aside[1] <= MOST, "too many elements")
    front.levels = [
        SimpleNamespace(vertices=v[l], elements=e[l], corners=c[l], shift=s[l], error=x[l]) for l in range(L)
    ]


def read_attribute_tables(tables, A, front):
    rc = tables.rc
    front.layers, front.materials, front.labels, front.images = [], 0, [], 0
    front.has_lone = front.has_appearance = False
    full = front.levels[-1]
    rc.mark("attributes")
    if rc.bit(Models("attributes")):
        count = tables.number(A)
        require(count <= 32, "too many layers")
        for _ in range(count):
            front.layers.append(read_layer(tables, A))
            require(front.layers[-1].wedges <= min(full.corners, (1 << 31) - 1), "too many wedges")
        front.materials = tables.number(A)
        labels = tables.number(A)
        require(labels <= 65536, "too many labels")
        for _ in range(labels):
            material = tables.number(A)
            require(material <= front.materials, "a label has a material that is not there")
            mask = rc.raw(count, "layers of a label")
            front.labels.append(SimpleNamespace(material=material - 1, layers=[mask >> i & 1 for i in range(count)]))
        front.has_lone = bool(rc.raw(1, "lone"))
        front.has_appearance = bool(rc.raw(1, "appearance"))
        front.images = tables.number(A)
    require(not front.layers or front.labels, "layers without labels")
    require(front.has_appearance or front.materials + front.images == 0, "materials without an appearance")
    front.bare = not front.layers and len(front.labels) < 2
    require(front.bare or full.elements <= 1 << 31, "too many elements for labels")


def read_layer(tables, A):
    rc = tables.rc
    size = tables.number(A)
    require(size <= 1024, "a name is too long")
    layer = SimpleNamespace(name=bytes(rc.raw(8, "name") for _ in range(size)).decode())
    layer.kind = rc.uniform(5, "kind")
    layer.components = rc.raw(3, "components")
    require(1 <= layer.components <= 4, "components of a layer")
    layer.stored = rc.uniform(8, "stored")
    layer.linear = bool(rc.raw(1, "linear"))
    if layer.linear:
        layer.step = tables.float("step")
        layer.origin = [tables.float("origin") for _ in range(4)]
        require(layer.step > 0 and layer.kind in (0, 1, 4), "a linear quantizer")
        require(all(finite(abs(o) + 2.0**26 * layer.step) for o in layer.origin), "a linear quantizer")
        layer.numbers = layer.components
    else:
        layer.bits = rc.raw(5, "bits")
        require(2 <= layer.bits <= 16 and (layer.kind, layer.components) in ((2, 3), (3, 4)), "an octahedral quantizer")
        layer.numbers = 2 if layer.kind == 2 else 3
    layer.wedges = tables.number(A)
    return layer


def read_chunk_table(tables, count, front):
    rc = tables.rc
    rc.mark("chunk table")
    F, T, J = Models("F"), Models("T"), tables.difference_models("J", z=OFTEN)
    P, Q = Models("P", {(0,): SELDOM}), Models("Q", {(0,): SELDOM})
    N, I, M = tables.number_models("N"), tables.number_models("I"), tables.difference_models("M")
    following = memory = end = 0
    front.chunks = []
    for _ in range(count):
        before = front.chunks[-1] if front.chunks else None
        if before and before.segment + 1 < before.segments and rc.bit(F):
            chunk = SimpleNamespace(**vars(before))
            chunk.segment += 1
        else:
            chunk = SimpleNamespace(image=None)
            chunk.kind = rc.golomb(T)
            require(chunk.kind <= 255, "kind of a chunk")
            chunk.first = following + tables.difference(J)
            chunk.last = chunk.first + rc.golomb(P)
            chunk.segments = rc.golomb(Q) + 1
            chunk.segment = rc.golomb(Q)
            if chunk.kind in (IMAGE, RECIPE):
                chunk.image = tables.number(I)
            following = chunk.last + 1
        chunk.size = tables.number(N, 1 << 62)
        memory += tables.difference(M)
        chunk.memory = memory
        end += chunk.size
        require(0 <= memory <= 320 and end < 1 << 62, "a row of the chunk table")
        front.chunks.append(chunk)


def check_order(front):
    """The rules of 'Kinds of chunks'."""
    full = len(front.levels) - 1
    geometry = []
    appearance = False
    pieces, recipes, asides, lones = {}, set(), 0, 0
    last_image = None
    for chunk in front.chunks:
        kind = chunk.kind
        require(not RECIPE < kind < SOURCE, "a kind of chunk that is not known: %d" % kind)
        require(0 <= chunk.first <= chunk.last <= full and chunk.segment < chunk.segments, "levels of a chunk")
        if kind in (BASE, LEVELS, ASIDE, LONE, APPEARANCE, RECIPE):
            require(chunk.segments == 1, "a chunk with segments")
        if kind <= SEGMENT:
            geometry.append(chunk)
            require((kind == BASE) == (len(geometry) == 1), "the base has to come first")
            require(kind != SEGMENT or chunk.first == chunk.last, "a segment of several levels")
            before = geometry[-2] if len(geometry) > 1 else None
            if before and before.segment + 1 < before.segments:
                same = (before.kind, before.first, before.last, before.segments, before.segment + 1)
                require(same == (kind, chunk.first, chunk.last, chunk.segments, chunk.segment), "order of segments")
            else:
                require(chunk.first == (before.last + 1 if before else 0) and chunk.segment == 0, "order of levels")
        elif kind in (ASIDE, LONE):
            require(chunk.first == chunk.last == full, "aside and lone chunks belong to the full level")
            require(geometry and geometry[-1].last == full, "a chunk of the full level comes too early")
            require(geometry[-1].segment + 1 == geometry[-1].segments, "a chunk of the full level comes too early")
            asides, lones = asides + (kind == ASIDE), lones + (kind == LONE)
        elif kind == APPEARANCE:
            require(not appearance, "two appearances")
            appearance = True
        elif kind == IMAGE:
            require(appearance and chunk.image < front.images, "a piece of an image that is not there")
            number, segments = pieces.get(chunk.image, (0, chunk.segments))
            require((number, segments) == (chunk.segment, chunk.segments), "order of the pieces of an image")
            pieces[chunk.image] = (number + 1, segments)
        elif kind == RECIPE:
            whole = pieces.get(chunk.image, (0, 1))
            require(whole[0] == whole[1] and chunk.image not in recipes, "a recipe before its image, or a second one")
            recipes.add(chunk.image)
    require(geometry and geometry[-1].last == full, "the full level is not there")
    require(geometry[-1].segment + 1 == geometry[-1].segments, "the full level is not there")
    require(asides == int(front.aside[0] > 0), "an aside chunk is there exactly if it has elements")
    require(lones == int(front.has_lone), "a lone chunk is there exactly if the tables say so")
    require(appearance == front.has_appearance, "an appearance chunk is there exactly if the tables say so")
    require(len(pieces) == front.images and all(a == b for a, b in pieces.values()), "images are not whole")
