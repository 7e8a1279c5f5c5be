#!/usr/bin/env python3
"""Decodes a .lods file of version 1: a reference, small and slow, written from docs/format alone."""

import argparse
import os
import sys

from arithmetic import Damaged
from mesh import numbers, place
from reader import read_file
from tracing import Trace

UV, NORMAL = 1, 2


def write_obj(out, file, number):
    """A level as OBJ, with the first layers of texture coordinates and normals."""
    front, level = file.front, file.levels[number]
    full = number + 1 == len(file.levels)
    for v in range(len(level.positions)):
        out.write("v %.17g %.17g %.17g\n" % tuple(place(front, level, v)))
    elements = list(level.elements)
    aside = file.aside if full else []
    indices = []  # for vt and vn: for each element its numbers in OBJ, or None
    for kind, word in ((UV, "vt"), (NORMAL, "vn")):
        l = next((l for l, layer in enumerate(front.layers) if layer.kind == kind), None)
        if l is None:
            indices.append([None] * (len(elements) + len(aside)))
            continue
        values = list(level.values[l])
        of = [None if wedges is None else [w + 1 for w in wedges] for wedges in level.corners[l]]
        for own in file.lone[1][l] if file.lone and full else [None] * len(aside):
            of.append(None if own is None else [len(values) + i + 1 for i in range(len(own))])
            values += own or []
        for value in values:
            out.write(word + " %.17g" * front.layers[l].components % tuple(numbers(front.layers[l], value)) + "\n")
        indices.append(of)
    for element, vt, vn in zip(elements + aside, *indices):
        corners = []
        for i, v in enumerate(element):
            corner = str(v + 1)
            if len(element) > 2 and (vt or vn):
                corner += "/%s" % (vt[i] if vt else "") + ("/%d" % vn[i] if vn else "")
            corners.append(corner)
        out.write("%s %s\n" % ("f" if len(element) > 2 else "l", " ".join(corners)))


def write_images(folder, file):
    os.makedirs(folder, exist_ok=True)
    for i, image in enumerate(file.appearance.images if file.appearance else []):
        for name, data in [("image-%d" % i, image.file)] + [
            ("image-%d-preview-%d" % (i, n), data) for n, data in image.previews
        ]:
            end = ".jpg" if data[:2] == b"\xff\xd8" else ".png" if data[:4] == b"\x89PNG" else ""
            with open(os.path.join(folder, name + end), "wb") as out:
                out.write(data)


def print_summary(file):
    front = file.front
    print("lattice   step %r, origin %r" % (front.step, front.origin))
    for l, (row, level) in enumerate(zip(front.levels, file.levels)):
        error = "exact" if row.error == 0 else "unknown" if row.error == 1023 else "%.4g" % (
            front.step * 2.0 ** ((row.error - 129) / 16)
        )
        counts = (l, len(level.positions), len(level.elements), row.shift, error)
        print("level %3d  %7d vertices  %7d elements  shift %2d  error %s" % counts)
    if file.aside:
        print("aside     %d elements that repeat a vertex" % len(file.aside))
    for l, layer in enumerate(front.layers):
        print("layer %d   %r, kind %d, %d components, %d wedges" % (
            l, layer.name, layer.kind, layer.components, layer.wedges))
    if file.appearance:
        print("materials %d" % len(file.appearance.materials))
        for image in file.appearance.images:
            print("image     %r %s %d bytes, %d previews" % (
                image.name, image.mime or "?", len(image.file), len(image.previews)))


def main():
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="Without -o, --images and --trace it prints what the file holds. Exit code 1: the file is damaged.",
    )
    parser.add_argument("file", metavar="FILE", help="a .lods file")
    parser.add_argument("-o", "--output", metavar="OBJ", help="write the mesh here, as OBJ; - is standard output")
    parser.add_argument("--level", type=int, metavar="N", help="of this level (default: the full one)")
    parser.add_argument("--images", metavar="FOLDER", help="write images and previews into this folder")
    parser.add_argument("--trace", metavar="OUT", help="write the symbols of all streams here, as a text")
    parser.add_argument(
        "--symbols", type=int, default=0, metavar="N",
        help="write only the first N symbols of each stream, and checksums of all of them (default: write all)",
    )
    arguments = parser.parse_args()
    trace_out = open(arguments.trace, "w", newline="\n") if arguments.trace else None
    try:
        with open(arguments.file, "rb") as source:
            data = source.read()
        file = read_file(data, Trace(trace_out.write, arguments.symbols) if trace_out else None)
    except (Damaged, OSError) as error:
        sys.exit("%s: %s" % (arguments.file, error))
    finally:
        if trace_out:
            trace_out.close()
    number = len(file.levels) - 1 if arguments.level is None else arguments.level
    if not 0 <= number < len(file.levels):
        sys.exit("%s: its levels are 0 to %d" % (arguments.file, len(file.levels) - 1))
    if arguments.output == "-":
        write_obj(sys.stdout, file, number)
    elif arguments.output:
        with open(arguments.output, "w", newline="\n") as out:
            write_obj(out, file, number)
    if arguments.images:
        write_images(arguments.images, file)
    if not (arguments.output or arguments.images or arguments.trace):
        print_summary(file)


if __name__ == "__main__":
    main()
