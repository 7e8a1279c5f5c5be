"""Traces of symbols, to compare another decoder with. tests/conformance/README.md says what the lines mean."""

import zlib


class Trace:
    """Writes the first `limit` symbols of each stream (all for 0), and checksums of all of them."""

    EVERY = 1000

    def __init__(self, write, limit):
        self.write, self.limit = write, limit
        self.count = self.crc = 0

    def begin(self, title):
        self.count = self.crc = 0
        self.write("stream %s\n" % title)

    def shown(self):
        return not self.limit or self.count < self.limit

    def mark(self, text):
        if self.shown():
            self.write("# %s\n" % text)

    def symbol(self, kind, name, context, total, value, range_, code):
        where = "[%s]" % ",".join(map(str, context)) if kind == "bit" else ""
        name = name.replace(" ", "_")
        line = "%s %s%s %d %s %x %x\n" % (kind, name, where, total, value, range_, code)
        if self.shown():
            self.write(line)
        self.count += 1
        self.crc = zlib.crc32(line.encode(), self.crc)
        if self.limit and self.count > self.limit and self.count % self.EVERY == 0:
            self.write("after %d %08x\n" % (self.count, self.crc))

    def end(self):
        self.write("end %d %08x\n" % (self.count, self.crc))
