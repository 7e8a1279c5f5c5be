"""The range coder and its adaptive models of a bit. docs/format: Range coder."""

from arithmetic import require

TOP = 1 << 64


class Models:
    """Models of bits that share a name in the text, by context; each is fresh until it is met.

    `fresh` is their probability at the start, or a table of those by context (for other contexts: 32768).
    """

    def __init__(self, name, fresh=32768):
        self.name, self.fresh, self.models = name, fresh, {}

    def of(self, context):
        if context not in self.models:
            p = self.fresh.get(context, 32768) if isinstance(self.fresh, dict) else self.fresh
            self.models[context] = [p, p, 0]
        return self.models[context]


class RangeDecoder:
    def __init__(self, data, trace=None):
        self.data, self.trace = data, trace
        self.range, self.code, self.place = TOP - 1, 0, 0
        self.code = self.bytes(8)

    def bytes(self, count):
        """The next bytes as a number, BE; behind the end there are zeros."""
        piece = bytes(self.data[self.place : self.place + count])
        self.place += count
        return int.from_bytes(piece.ljust(count, b"\0"), "big")

    def narrow(self, offset, width):
        self.code, self.range = (self.code - offset) % TOP, width
        while self.range < 1 << 32:
            self.code = (self.code << 32 | self.bytes(4)) % TOP
            self.range = (self.range << 32) % TOP
            require(self.place <= len(self.data) + 12, "a stream is read too far beyond its end")

    def record(self, kind, name, context, total, value):
        if self.trace:
            self.trace.symbol(kind, name, context, total, value, self.range, self.code)

    def mark(self, text):
        if self.trace:
            self.trace.mark(text)

    # Symbols

    def uniform(self, total, name):
        unit = self.range // total
        value = min(self.code // unit, total - 1)
        if total > 1:
            self.narrow(unit * value, unit)
            self.record("uniform", name, (), total, value)
        return value

    def choose(self, frequencies, name):
        total = sum(frequencies)
        unit = self.range // total
        t = min(self.code // unit, total - 1)
        below = 0
        for symbol, frequency in enumerate(frequencies):
            if t < below + frequency:
                break
            below += frequency
        self.narrow(unit * below, unit * frequency)
        self.record("choose", name, (), total, symbol)
        return symbol

    def raw(self, n, name):
        if n <= 16:
            return self.uniform(1 << n, name)
        if n <= 32:
            high = self.uniform(1 << (n - 16), name)
            return high << 16 | self.uniform(1 << 16, name)
        high = self.raw(n - 32, name)
        return high << 32 | self.raw(32, name)

    def bit(self, models, *context):
        model = models.of(context)
        fast, slow, seen = model
        p = min(max((fast + slow) // 2, 16), 65520)
        bound = (self.range >> 16) * p
        bit = 1 if self.code < bound else 0
        if bit:
            self.narrow(0, bound)
        else:
            self.narrow(bound, self.range - bound)
        target = 65535 if bit else 0
        if seen < 120:
            s = 655360 // (10 * seen + 16)
            f = max(s, 2048)
            model[0] = fast + ((target - fast) * f >> 16)
            model[1] = slow + ((target - slow) * s >> 16)
            model[2] = seen + 1
        else:
            model[0] = fast + ((target - fast) >> 5)
            model[1] = slow + ((target - slow) >> 7)
        self.record("bit", models.name, context, p, bit)
        return bit

    def target(self, total):
        """A place within `total`; one `take` follows it."""
        self.total, self.unit = total, self.range // total
        return min(self.code // self.unit, total - 1)

    def take(self, start, width, name):
        self.narrow(self.unit * start, self.unit * width)
        self.record("take", name, (), self.total, "%d+%d" % (start, width))

    def golomb(self, models, *context):
        n = 0
        while n < 32 and self.bit(models, *context, n):
            n += 1
        if n == 0:
            return 0
        t = self.bit(models, *context, 32 + min(n, 31))
        r = self.raw(n - 1, models.name)
        return min((1 << n) + (t << (n - 1)) + r - 1, (1 << 32) - 1)
