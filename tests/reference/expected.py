"""What the files of `tests/conformance` decode to, as lines of text with checksums; the README there says of what."""

import zlib

from golden import NONE, Sum, describe


def degrees_and_corners(elements):
    return [n for element in elements for n in (len(element),) + tuple(element)]


def checksum(numbers):
    total = Sum()
    total.u32(numbers)
    return total.crc


def level_line(front, number, level):
    attributes = level.labels[:] if len(front.labels) >= 2 else []
    for corners, values in zip(level.corners, level.values):
        for element, wedges in zip(level.elements, corners):
            attributes += [NONE] * len(element) if wedges is None else wedges
        attributes += [x for value in values for x in value]
    counts = (number, len(level.positions), len(level.elements), sum(map(len, level.elements)), level.shift)
    sums = (
        checksum([c for p in level.positions for c in p]),
        checksum(degrees_and_corners(level.elements)),
        checksum(attributes),
    )
    return "level %d: %d vertices, %d elements, %d corners, shift %d, %08x %08x %08x" % (counts + sums)


def expected(file):
    lines = [level_line(file.front, number, level) for number, level in enumerate(file.levels)]
    if file.aside:
        counts = (len(file.aside), sum(map(len, file.aside)), checksum(degrees_and_corners(file.aside)))
        lines.append("aside: %d elements, %d corners, %08x" % counts)
    for i, image in enumerate(file.appearance.images if file.appearance else []):
        lines.append("image %d: %d bytes, %08x" % (i, len(image.file), zlib.crc32(image.file)))
    lines.append(describe("all", file))
    return "".join(line + "\n" for line in lines)
