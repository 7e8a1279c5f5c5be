"""Labels, wedges and their values: of level 0, of splits, and lone ones. docs/format: Attributes."""

from arithmetic import require
from range_coder import Models
from splits import ONE, TWO
from values import Far, Fit, Fitted, Frame, checked, read_pair, read_reach, similar


def halves(m, delta, bias):
    """Two numbers with the middle m that differ by delta."""
    total = 2 * m - bias + (delta + bias) % 2
    first = (total + delta) >> 1
    return first, first - delta


# Level 0 and lone values


def read_labels(rc, model, front, count):
    if len(front.labels) < 2:
        return [0] * count
    b, labels = 0, []
    for _ in range(count):
        if not rc.bit(model):
            b = rc.uniform(len(front.labels), "label")
        labels.append(b)
    return labels


def read_level0(rc, front, elements):
    """Labels, and for each layer the wedges of corners (None for elements without) and the values of wedges."""
    if front.bare:
        return [0] * len(elements), [], []
    label, known, last = Models("label", 50000), Models("known", 50000), Models("last", 50000)
    rc.mark("labels")
    labels = read_labels(rc, label, front, len(elements))
    corners, values = [], []
    for number, layer in enumerate(front.layers):
        rc.mark("layer %d" % number)
        far = Far(layer.numbers)
        layer_corners, layer_values, at = [], [], {}
        for element, l in zip(elements, labels):
            if not front.labels[l].layers[number]:
                layer_corners.append(None)
                continue
            guess, kind, wedges = far.recent, 0, []
            for v in element:
                here = at.setdefault(v, [])
                n = min(len(here), 64)
                if n > 0 and rc.bit(known):
                    back = 0 if n == 1 or rc.bit(last) else 1 + rc.uniform(n - 1, "known")
                    wedge = here[-1 - back]
                else:
                    wedge = len(layer_values)
                    layer_values.append(far.decode(rc, kind, guess))
                    here.append(wedge)
                wedges.append(wedge)
                guess, kind = layer_values[wedge], 1
            layer_corners.append(wedges)
        require(len(layer_values) <= layer.wedges, "too many wedges")
        corners.append(layer_corners)
        values.append(layer_values)
    return labels, corners, values


def read_lone(rc, front, aside, isolated):
    """Labels of the elements aside, and for each layer the values at their corners and at isolated vertices."""
    rc.mark("labels")
    labels = read_labels(rc, Models("label", 50000), front, len(aside))
    corner_values, vertex_values = [], []
    for number, layer in enumerate(front.layers):
        rc.mark("layer %d" % number)
        far, present = Far(layer.numbers), Models("present")
        corner_values.append([
            [far.decode(rc, 0, far.recent) for _ in element] if front.labels[l].layers[number] else None
            for element, l in zip(aside, labels)
        ])
        vertex_values.append({v: far.decode(rc, 1, far.recent) for v in isolated if rc.bit(present)})
    return labels, corner_values, vertex_values


# Attributes of a split


class AttributeState:
    """Part of the state."""

    def __init__(self, front):
        self.same = Models("same", {(0,): 60000, (1,): 32768, (2,): 50000})
        self.second = Models("second", 60000)
        self.layers = [LayerState(layer.numbers) for layer in front.layers]


class LayerState:
    def __init__(self, numbers):
        self.regular = Models("regular", 60000)
        self.choice, self.linked, self.inside = Models("choice"), Models("linked"), Models("inside")
        self.new, self.mirrored = Models("new"), Models("mirrored")
        self.apex, self.same, self.main = Models("apex", 50000), Models("same", 50000), Models("main", 50000)
        self.middle, self.kept = Models("middle", 60000), Models("kept", 60000)
        self.far, self.fitted = Far(numbers), Fitted(numbers)


class Local:
    """A local wedge of a child, out of a group (a wedge of the coarser level) or of none; or a new apex wedge."""

    def __init__(self, child, group, triangle=None):
        self.child, self.group, self.triangle = child, group, triangle
        self.wedge = self.value = None


class Batch:
    """What the splits of a batch do to the wedges."""

    def __init__(self, front, level):
        self.front, self.level = front, level
        self.changed = [{} for _ in front.layers]
        self.appended = [[] for _ in front.layers]

    def append(self, layer, local, value):
        local.wedge = len(self.level.values[layer]) + len(self.appended[layer])
        local.value = value
        self.appended[layer].append(value)

    def keep(self, layer, local, value):
        local.wedge, local.value = local.group, value
        self.changed[layer][local.group] = value


class Inserted:
    """An element that a split inserts."""

    def __init__(self, apex, turned, beside):
        self.apex, self.turned, self.beside = apex, turned, beside  # beside: (spoke, corner's vertex)
        self.label = 0
        self.wedges = []  # for each layer: local wedges of the first and second child, and at the apex; or None


def read_split(rc, state, batch, around, cut, delta, bias):
    """The inserted elements with their attributes, and for each layer the local wedges of each spoke by child."""
    front = batch.front
    inserted = []
    for apex, turned in cut.triangles:
        beside = [i for i in range(len(around.spokes)) if apex in (around.next[i], around.previous[i])]
        inserted.append(Inserted(apex, turned, [(i, apex) for i in beside[:64]]))
    for _ in range(cut.dangling):
        inserted.append(Inserted(None, False, [(0, around.v)] if around.spokes else []))
    if front.bare:
        return inserted, []
    if len(front.labels) >= 2:
        b = 0
        for element in inserted:
            b = element.label = read_label(rc, state, batch, around, element, b)
    frame = Frame(around, delta)
    spokes = [
        LayerSplit(rc, state.layers[layer], batch, layer, around, cut, inserted, frame, bias).read()
        for layer in range(len(front.layers))
    ]
    return inserted, spokes


def read_label(rc, state, batch, around, element, b):
    labels = [batch.level.labels[around.spokes[i]] for i, _ in element.beside]
    first = labels[0] if labels else b
    second = next((l for l in labels if l != first), None)
    if rc.bit(state.same, 2 if not labels else 0 if second is None else 1):
        return first
    if second is not None and rc.bit(state.second):
        return second
    return rc.uniform(len(batch.front.labels), "label")


class LayerSplit:
    def __init__(self, rc, models, batch, layer, around, cut, inserted, frame, bias):
        self.rc, self.models, self.batch, self.layer = rc, models, batch, layer
        self.around, self.cut, self.frame, self.bias = around, cut, frame, bias
        level = batch.level
        self.corners, self.values = level.corners[layer], level.values[layer]
        self.spoke_groups = [self.wedge_at(e, around.v) for e in around.spokes]
        self.groups = sorted({g for g in self.spoke_groups if g is not None})
        self.all = inserted
        self.inserted = [i for i in inserted if batch.front.labels[i.label].layers[layer]]
        self.locals, self.apexes, self.fits = [], [], {}
        self.loose = None  # the local wedges of the last inserted element without a group
        self.regular = False

    def wedge_at(self, e, v):
        wedges = self.corners[e]
        return None if wedges is None else wedges[self.batch.level.elements[e].index(v)]

    def read(self):
        for element in self.all:
            element.wedges.append(None)
        if not self.groups and not self.inserted:
            return [None] * len(self.around.spokes)
        rc, models = self.rc, self.models
        places = {id(element): self.places(element) for element in self.inserted}
        first_dangling = next((element for element in self.all if element.apex is None), None)
        torn = 0
        for element in self.inserted:
            counts = element.apex is not None or element is first_dangling
            torn += counts and len(places[id(element)]) != 1
        crowd = len(self.groups)
        if crowd >= 2:
            crowd = 2 if crowd < len(self.around.spokes) else 3
        self.regular = bool(rc.bit(models.regular, 4 * crowd + min(torn, 3)))
        spokes = []
        for i, group in enumerate(self.spoke_groups):
            of = {}
            if group is not None:
                for child in (0, 1):
                    if self.cut.sides[i] != (TWO if child == 0 else ONE):
                        of[child] = self.local(group, child)
            spokes.append(of if group is not None else None)
        for element in self.inserted:
            element.wedges[-1] = self.read_inserted(element, places[id(element)])
        self.read_values()
        return spokes

    def places(self, element):
        found = {}
        for i, corner in element.beside:
            if self.spoke_groups[i] is not None:
                pair = (self.spoke_groups[i], self.wedge_at(self.around.spokes[i], corner))
                found.setdefault(pair, self.cut.sides[i])
        return [(group, wedge, side) for (group, wedge), side in list(found.items())[:16]]

    def local(self, group, child):
        """The local wedge of a child out of a group: regular, or told."""
        rc, models = self.rc, self.models
        there = [l for l in self.locals if l.child == child and l.group == group]
        if there:
            if self.regular:
                return there[-1]
            if rc.bit(models.same, min(len(there), 2) - 1):
                return there[-1]
            m = min(len(there) - 1, 64)
            if m > 0 and not rc.bit(models.new, 1):
                return there[-1 - (1 + rc.uniform(m, "told"))]
        self.locals.append(Local(child, group))
        return self.locals[-1]

    def read_inserted(self, element, places):
        rc, models, n = self.rc, self.models, len(places)
        require(n > 0 or not self.regular, "an element without a place in a regular split")
        linked = n > 0 and (self.regular or bool(rc.bit(models.linked, min(n, 3))))
        group = place_wedge = None
        if linked:
            i = 0
            while i + 1 < n and not rc.bit(models.choice, 2 * min(i, 3) + (places[i][2] == ONE)):
                i += 1
            group, place_wedge, _ = places[i]
        elif self.groups and rc.bit(models.inside, min(len(self.groups), 4) - 1):
            group = self.groups[rc.uniform(len(self.groups), "inside")]
        ends = []
        for child in (0, 1):
            if group is not None:
                ends.append(self.local(group, child))
            elif self.loose and rc.bit(models.new, 0):
                ends.append(self.loose[child])
            else:
                self.locals.append(Local(child, None))
                ends.append(self.locals[-1])
        if group is None:
            self.loose = ends
        if element.apex is None:
            return ends
        return ends + [self.read_apex(element, linked, place_wedge, ends)]

    def read_apex(self, element, linked, place_wedge, ends):
        rc, models, level = self.rc, self.models, self.batch.level
        if linked and (self.regular or rc.bit(models.apex, 0)):
            return place_wedge
        if rc.bit(models.apex, 2 if linked else 1):
            x = element.apex
            some = [e for e in level.stars[x][:64] if len(level.elements[e]) <= 64]
            choices = sorted({self.wedge_at(e, x) for e in some} - {None})
            choices += [a for a in self.apexes[-64:] if a.triangle[0].apex == x]
            require(choices, "no wedge to choose from")
            return choices[rc.uniform(len(choices), "apex")]
        self.apexes.append(Local(None, None, (element, ends)))
        return self.apexes[-1]

    def fit(self, group):
        if group not in self.fits:
            own = self.values[group]
            self.fits[group] = Fit(self.frame, self.corners, self.values, group, self.spoke_groups, own)
        return self.fits[group]

    def read_values(self):
        rc, models, batch, layer = self.rc, self.models, self.batch, self.layer
        far = models.far
        main = {}
        for group in self.groups:
            own = self.values[group]
            of = [[l for l in self.locals if l.group == group and l.child == child] for child in (0, 1)]
            mains = []
            for there in of:
                n = len(there)
                if n == 0:
                    continue
                back = 0
                if not self.regular and n > 1 and not rc.bit(models.main):
                    back = 1 + rc.uniform(n - 1, "main")
                mains.append(there[-1 - back])
                main[group, there[0].child] = mains[-1]
            if len(mains) == 1:
                kept = self.regular or rc.bit(models.kept)
                batch.keep(layer, mains[0], own if kept else far.decode(rc, 3, own))
                continue
            if self.regular or rc.bit(models.middle):
                d = read_pair(rc, models.fitted, self.frame, self.fit(group))
                a, b = zip(*(halves(own[i], d[i], self.bias) for i in range(len(own))))
                a, b = checked(a), checked(b)
            else:
                a = far.decode(rc, 3, own)
                b = far.decode(rc, 3, a)
            batch.keep(layer, mains[0], a)
            batch.append(layer, mains[1], b)
        k = None
        for local in self.locals:
            if local.wedge is not None:
                continue
            if local.group is not None:
                batch.append(layer, local, far.decode(rc, 3, main[local.group, local.child].value))
                k = None
            else:
                k = 1 if k == 0 else 0
                batch.append(layer, local, far.decode(rc, k, far.recent))
        for apex in self.apexes:
            element, (first, second) = apex.triangle
            r = self.around.relative(element.apex)
            if first.group is not None:
                fit, own = self.fit(first.group), self.values[first.group]
                batch.append(layer, apex, read_reach(rc, models.fitted, self.frame, fit, r, own))
                continue
            left = not element.turned
            A, B = first.value, second.value
            if len(A) == 2 and rc.bit(models.mirrored):
                left = not left
            batch.append(layer, apex, far.decode(rc, 2, similar(A, B, left, r, self.frame.delta)))


def wedge_number(end):
    return end.wedge if isinstance(end, Local) else end
