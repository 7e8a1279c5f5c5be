"""A whole file, chunk by chunk: levels, what lies aside, materials and images. docs/format: Kinds of chunks; Chunks and
segments."""

import copy
from types import SimpleNamespace

from appearance import read_appearance, read_preview
from arithmetic import require
from attributes import Batch, read_lone
from container import (
    APPEARANCE, ASIDE, BASE, IMAGE, KINDS, LEVELS, LONE, PREVIEW, RECIPE, SEGMENT, SOURCE, read_front,
)
from elements import read_aside
from levels import State, read_base, read_segment, refine, segments_of
from jpeg import apply_recipe
from range_coder import RangeDecoder


def read_file(data, trace=None, on_level=None):
    """All that a file holds. `on_level(number, level)` is called with each level; they are in the result as well."""
    front = read_front(data, trace)
    file = SimpleNamespace(front=front, levels=[], aside=[], lone=None, appearance=None, source=None)
    file.begun = set()
    run = SimpleNamespace(state=State(front), segments=[], batch=None, before=None)

    def level_is_there(level):
        file.levels.append(level)
        if on_level:
            on_level(len(file.levels) - 1, level)

    for number, chunk in enumerate(front.chunks):
        kind = chunk.kind
        rc = None
        if kind <= APPEARANCE:
            if trace:
                levels = "levels %d to %d" % (chunk.first, chunk.last)
                segment = "segment %d of %d" % (chunk.segment, chunk.segments)
                trace.begin("chunk %d %s %s %s" % (number, KINDS[kind], levels, segment))
            rc = RangeDecoder(chunk.payload, trace)
        if kind in (BASE, LEVELS):
            for l in range(chunk.first, chunk.last + 1):
                if l == 0:
                    level_is_there(read_base(rc, front))
                    continue
                level = file.levels[-1]
                batch = Batch(front, level)
                segment = read_segment(rc, front, run.state, level, l, 0, 1, batch)
                level_is_there(refine(front, level, l, [segment], batch))
        elif kind == SEGMENT:
            level, l = file.levels[-1], chunk.first
            require(chunk.segments == segments_of(len(level.positions)), "the number of segments")
            if chunk.segment == 0:
                run.segments, run.batch = [], Batch(front, level)
                run.before = copy.deepcopy(run.state)
                state = run.state
            else:
                state = copy.deepcopy(run.before)
            segment = read_segment(rc, front, state, level, l, chunk.segment, chunk.segments, run.batch)
            run.segments.append(segment)
            if chunk.segment + 1 == chunk.segments:
                level_is_there(refine(front, level, l, run.segments, run.batch))
        elif kind == ASIDE:
            file.aside = read_aside(rc, len(file.levels[-1].positions), front.aside)
        elif kind == LONE:
            named = {v for element in file.aside for v in element}
            stars = file.levels[-1].stars
            isolated = [v for v in range(len(stars)) if not stars[v] and v not in named]
            file.lone = read_lone(rc, front, file.aside, isolated)
        elif kind == APPEARANCE:
            file.appearance = read_appearance(rc, front)
        elif kind == IMAGE:
            file.appearance.images[chunk.image].file += chunk.payload
            file.begun.add(chunk.image)
        elif kind == RECIPE:
            image = file.appearance.images[chunk.image]
            image.file = apply_recipe(chunk.payload, image.file)
        elif kind == SOURCE:
            file.source = chunk.payload
        elif kind == PREVIEW:
            read_preview(chunk.payload, file.appearance, file.begun)
        if rc and trace:
            trace.end()
    return file
