"""Adaptive densities of integers around an expected value. docs/format: Densities."""

from arithmetic import cut, cut_to
from range_coder import Models

HALF = [1960, 1800, 1640, 1480, 1330, 1190, 1060, 940, 1560, 1130, 800, 560, 600, 250, 90, 40, 14]
WEIGHTS = HALF[::-1] + HALF


def bin_of(t):
    """The bin at t, in 1/65536 spread, and the part of it below t, of 256."""
    u = min(abs(t), (1 << 18) - 1)
    if u < 1 << 16:
        i, f = u >> 13, (u % (1 << 13)) >> 5
    elif u < 1 << 17:
        i, f = 8 + ((u - (1 << 16)) >> 14), (u % (1 << 14)) >> 6
    else:
        i, f = 12 + ((u - (1 << 17)) >> 15), (u % (1 << 15)) >> 7
    return (16 - i, 256 - f) if t < 0 else (17 + i, f)


class Density:
    def __init__(self, name):
        self.name = name
        self.F, total = [0], 0
        for weight in WEIGHTS:
            total += weight
            self.F.append((total << 23) // 32888)
        self.seen, self.dither, self.escape = 0, 0x9E3779B9, Models(name + ".escape")

    def decode(self, rc, m, s):
        s, low = max(s, 72), 0
        while s > 1 << 18:
            s, m, low = s >> 1, m >> 1, low + 1
        h = (1 << 40) // s
        first, end = (m - 4 * s + 383) // 256, (m + 4 * s + 128) // 256
        total = (1 << 23) + end - first
        F = self.F

        def at(k):
            b, f = bin_of((128 * (2 * k - 1) - m) * h >> 24)
            return F[b] + ((F[b + 1] - F[b]) * f >> 8) + k - first

        t = rc.target(total)
        below, above = at(first), at(end)
        if t < below:
            rc.take(0, below, self.name)
            k, b = first - 1 - rc.golomb(self.escape), 0
        elif t >= above:
            rc.take(above, total - above, self.name)
            k, b = end + rc.golomb(self.escape), 33
        else:
            k, behind = first, end
            while behind - k > 1:
                middle = (k + behind) // 2
                if at(middle) <= t:
                    k = middle
                else:
                    behind = middle
            rc.take(at(k), at(k + 1) - at(k), self.name)
            self.dither = (1664525 * self.dither + 1013904223) % (1 << 32)
            b, _ = bin_of(cut_to((256 * k + (self.dither >> 24) - 128 - m) * h >> 24, (1 << 18) - 1))
        self.learn(b)
        k = cut(k, -(1 << 30), 1 << 30)
        if low > 0:
            k = (k << low) + rc.raw(low, self.name)
        return k

    def learn(self, b):
        rate = 5 + sum(self.seen >= bound for bound in (12, 60, 180, 600))
        self.seen = min(self.seen + 1, 65535)
        F = self.F
        for i in range(1, 34):
            target = (1 << 23) - 800 * (34 - i) if i > b else 800 * i
            F[i] += (target - F[i]) >> rate
