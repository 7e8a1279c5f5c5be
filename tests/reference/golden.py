"""What `tests/golden/v1/list.txt` says of a file: counts, and a checksum of all that it decodes to, as
`tests/suite/common/outcome.rs` sums it up."""

import struct
import zlib

from mesh import numbers, place

NONE = (1 << 32) - 1


def starts(elements):
    start = [0]
    for element in elements:
        start.append(start[-1] + len(element))
    return start


def flat(elements):
    return [v for element in elements for v in element]


class Sum:
    def __init__(self):
        self.crc = 0

    def bytes(self, data):
        self.crc = zlib.crc32(data, self.crc)

    def u32(self, numbers):
        self.bytes(b"".join((n & NONE).to_bytes(4, "little") for n in numbers))

    def u64(self, numbers):
        self.bytes(b"".join(n.to_bytes(8, "little") for n in numbers))

    def f64(self, numbers):
        self.bytes(b"".join(struct.pack("<d", n) for n in numbers))


def describe(name, file):
    front, total = file.front, Sum()
    told = len(front.labels) >= 2
    for level in file.levels:
        total.u32([level.shift])
        total.u32([c for p in level.positions for c in p])
        total.u32(starts(level.elements) + flat(level.elements))
        total.u32([NONE if p is None else p for p in level.parents])
        for corners, values in zip(level.corners, level.values):
            for element, wedges in zip(level.elements, corners):
                total.u32([NONE] * len(element) if wedges is None else wedges)
            total.u32([x for value in values for x in value])
        if told:
            total.u32(level.labels)
    if file.aside:
        total.u32(starts(file.aside) + flat(file.aside))

    # The mesh.
    level = file.levels[-1]
    total.f64([c for v in range(len(level.positions)) for c in place(front, level, v)])
    for l, layer in enumerate(front.layers):
        values = list(level.values[l])
        corners, isolated = [], []
        for element, wedges in zip(level.elements, level.corners[l]):
            corners += [NONE] * len(element) if wedges is None else wedges
        if file.lone:
            for element, own in zip(file.aside, file.lone[1][l]):
                for i in range(len(element)):
                    corners.append(NONE if own is None else len(values))
                    values += [] if own is None else [own[i]]
            for v, value in sorted(file.lone[2][l].items()):
                isolated += [v, len(values)]
                values.append(value)
        corners += [NONE] * (sum(map(len, level.elements + file.aside)) - len(corners))
        total.f64([x for value in values for x in numbers(layer, value)])
        total.u64(corners + isolated)
        total.u64(layer.name.encode())
    if front.materials and file.appearance:
        labels = level.labels + (file.lone[0] if file.lone else [0] * len(file.aside))
        total.u64([front.labels[l].material & NONE if front.labels else NONE for l in labels])
    if file.appearance:
        for texts in (file.appearance.materials, file.appearance.textures, file.appearance.samplers):
            for text in texts:
                total.u64(text.encode())
        for image in file.appearance.images:
            total.u64(image.name.encode() + image.mime.encode() + image.file)
    faces = len(level.elements) + len(file.aside)
    counts = "%d levels, %d vertices, %d faces, %d layers"
    counts %= (len(file.levels), len(level.positions), faces, len(front.layers))
    return "%s: %s, checksum %08x" % (name, counts, total.crc)
