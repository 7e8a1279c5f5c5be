"""Integers, checksums, vectors and roots. docs/format: Conventions; The finer level, "Roots and units"."""

from math import isqrt


class Damaged(Exception):
    """What the text calls an error."""


def require(condition, message):
    if not condition:
        raise Damaged(message)


def div(a, b):
    """The division of the text, `a / b` between integers: it truncates towards 0."""
    quotient = abs(a) // abs(b)
    return quotient if (a < 0) == (b < 0) else -quotient


def bits(x):
    return x.bit_length()


def cut(x, low, high):
    return min(max(x, low), high)


def cut_to(x, limit):
    return min(max(x, -limit), limit)


def wrap64(x):
    """What two's complement of 64 bits keeps of x."""
    return (x + (1 << 63)) % (1 << 64) - (1 << 63)


def saturate64(x):
    return min(max(x, -(1 << 63)), (1 << 63) - 1)


def leb128(data, place):
    """A number at `place` and the place behind it; only its one spelling is taken."""
    number = 0
    for count in range(10):
        require(place < len(data), "a number is cut")
        byte = data[place]
        place += 1
        number |= (byte & 127) << (7 * count)
        if byte < 128:
            require(number < 1 << 64, "a number exceeds 64 bits")
            require(byte != 0 or count == 0, "a number is spelt in too many bytes")
            return number, place
    raise Damaged("a number has more than ten bytes")


def add(a, b):
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def sub(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


ZERO = (0, 0, 0)
ROOTS = [isqrt(i << 48) for i in range(257)]


def root(x):
    k = (64 - bits(max(x, 1))) // 2 * 2
    y = x << k
    i, f = y >> 56, (y >> 40) % (1 << 16)
    return ((ROOTS[i] + ((ROOTS[i + 1] - ROOTS[i]) * f >> 16)) << 4) >> (k // 2)


def unit(v):
    b = bits(abs(v[0]) | abs(v[1]) | abs(v[2]) | 1)
    s = tuple(c >> (b - 20) if b > 20 else c << (20 - b) for c in v)
    h = (1 << 40) // max(root(dot(s, s)), 1)
    return tuple(c * h >> 26 for c in s)


def length(v):
    """Of a vector, in 1/256."""
    return root(dot(v, v) << 8) << 4


def half(x):
    """Twice the place of the highest set bit, and one more if the bit below it is set."""
    b = bits(max(x, 1)) - 1
    return 2 * b + (x >> (b - 1) & 1) if b > 0 else 0
