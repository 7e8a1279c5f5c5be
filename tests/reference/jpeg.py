"""The very bytes of a baseline JPEG file, out of a progressive one with the same coefficients and a recipe.
docs/format: Recipes. The rest is in ITU T.81: B (markers), F.1.2 (baseline scans), G.1.2 (progressive ones)."""

from types import SimpleNamespace

from arithmetic import Damaged, require


def segments(file):
    """The segments of a file as (marker, bytes from the marker on, data of the scan), and what follows FF D9."""
    require(file[:2] == b"\xff\xd8", "no JPEG file")
    found, place = [], 2
    while True:
        while file[place : place + 2] == b"\xff\xff":
            place += 1
        require(place + 2 <= len(file) and file[place] == 0xFF, "no marker where there has to be one")
        marker = file[place + 1]
        if marker == 0xD9:
            return found, file[place + 2 :]
        size = int.from_bytes(file[place + 2 : place + 4], "big")
        require(size >= 2 and place + 2 + size <= len(file), "a segment is cut")
        segment = file[place : place + 2 + size]
        place += 2 + size
        start = place
        if marker == 0xDA:
            while True:
                place = file.find(b"\xff", place)
                require(0 <= place < len(file) - 1, "a scan is cut")
                if file[place + 1] != 0 and not 0xD0 <= file[place + 1] <= 0xD7:
                    break
                place += 2
        found.append((marker, segment, file[start:place]))


class Frame:
    """Components with their coefficients, 64 a block in zigzag order."""

    def __init__(self, segment):
        require(segment[4] == 8, "samples of other than 8 bits")
        height, width = (int.from_bytes(segment[i : i + 2], "big") for i in (5, 7))
        require(height > 0 and width > 0 and len(segment) == 10 + 3 * segment[9], "a frame that makes no sense")
        self.components = []
        for i in range(segment[9]):
            number, factors, _ = segment[10 + 3 * i : 13 + 3 * i]
            self.components.append(SimpleNamespace(number=number, h=factors >> 4, v=factors & 15))
        self.h, self.v = max(c.h for c in self.components), max(c.v for c in self.components)
        self.units = (-(-width // (8 * self.h)), -(-height // (8 * self.v)))
        for c in self.components:
            # Blocks that hold something of the picture, and those of whole units.
            c.own = (-(-(-(-width * c.h // self.h)) // 8), -(-(-(-height * c.v // self.v)) // 8))
            c.wide, c.high = self.units[0] * c.h, self.units[1] * c.v
            c.blocks = [[0] * 64 for _ in range(c.wide * c.high)]

    def scan(self, segment):
        """Components with their numbers of tables, and the four numbers of progressive scans."""
        count = segment[4]
        require(len(segment) == 8 + 2 * count and count >= 1, "a scan that makes no sense")
        chosen = []
        for i in range(count):
            number, tables = segment[5 + 2 * i : 7 + 2 * i]
            component = next((c for c in self.components if c.number == number), None)
            require(component is not None, "a scan of a component that is not there")
            chosen.append((component, tables >> 4, tables & 15))
        start, end, bits = segment[5 + 2 * count : 8 + 2 * count]
        return chosen, (start, end, bits >> 4, bits & 15)

    def units_of(self, chosen):
        """For each unit of a scan its blocks: which component of the scan, and the block."""
        if len(chosen) == 1:
            c = chosen[0][0]
            for y in range(c.own[1]):
                for x in range(c.own[0]):
                    yield [(0, c.blocks[y * c.wide + x])]
            return
        for y in range(self.units[1]):
            for x in range(self.units[0]):
                yield [
                    (i, c.blocks[(y * c.v + v) * c.wide + x * c.h + h])
                    for i, (c, _, _) in enumerate(chosen) for v in range(c.v) for h in range(c.h)
                ]


def huffman_tables(segment, tables):
    """Puts the tables of a segment into `tables`, by class and number: lists of (length, code, symbol)."""
    place = 4
    while place < len(segment):
        counts = segment[place + 1 : place + 17]
        symbols = segment[place + 17 : place + 17 + sum(counts)]
        require(len(counts) == 16 and len(symbols) == sum(counts), "a table is cut")
        codes, code, at = [], 0, 0
        for length in range(1, 17):
            for _ in range(counts[length - 1]):
                codes.append((length, code, symbols[at]))
                code, at = code + 1, at + 1
            code <<= 1
        tables[segment[place] >> 4, segment[place] & 15] = codes
        place += 17 + len(symbols)


# Coefficients of a progressive file


class BitReader:
    def __init__(self, data):
        self.data, self.place, self.held, self.count = data, 0, 0, 0

    def bit(self):
        if self.count == 0:
            byte = self.data[self.place] if self.place < len(self.data) else 0
            marker = byte == 0xFF and self.data[self.place + 1 : self.place + 2] != b"\0"
            if marker or self.place >= len(self.data):
                byte = 0
            else:
                self.place += 2 if byte == 0xFF else 1
            self.held, self.count = byte, 8
        self.count -= 1
        return self.held >> self.count & 1

    def bits(self, n):
        x = 0
        for _ in range(n):
            x = 2 * x + self.bit()
        return x

    def symbol(self, table):
        code = 0
        for length in range(1, 17):
            code = 2 * code + self.bit()
            if (length, code) in table:
                return table[length, code]
        raise Damaged("a code is missing")

    def signed(self, n):
        x = self.bits(n)
        return x if n == 0 or x >> (n - 1) else x - (1 << n) + 1

    def restart(self):
        self.count = 0
        if self.data[self.place : self.place + 1] == b"\xff":
            self.place += 2


def read_coefficients(parts):
    frame, tables, interval, scans = None, {}, 0, 0
    for marker, segment, data in parts:
        if marker == 0xC2:
            frame = Frame(segment)
        elif marker == 0xC4:
            huffman_tables(segment, tables)
        elif marker == 0xDD:
            interval = int.from_bytes(segment[4:6], "big")
        elif marker == 0xDA:
            require(frame is not None, "a scan before the frame")
            scans += 1
            require(scans <= 64, "too many scans")
            read_scan(frame, segment, data, tables, interval)
    require(frame is not None, "no progressive frame")
    return frame


def read_scan(frame, segment, data, tables, interval):
    chosen, (start, end, high, low) = frame.scan(segment)
    kinds = [(0, dc) for _, dc, _ in chosen] if start == 0 else [(1, ac) for _, _, ac in chosen]
    codes = [{(l, code): symbol for l, code, symbol in tables.get(kind, [])} for kind in kinds]
    bits, before, run = BitReader(data), [0] * len(chosen), 0
    for number, unit in enumerate(frame.units_of(chosen)):
        if interval and number and number % interval == 0:
            bits.restart()
            before, run = [0] * len(chosen), 0
        for i, block in unit:
            if start == 0 and high == 0:
                before[i] += bits.signed(bits.symbol(codes[i]))
                block[0] = before[i] << low
            elif start == 0:
                block[0] |= bits.bit() << low
            elif high == 0:
                run = first_pass(bits, block, codes[i], start, end, low, run)
            else:
                run = refining_pass(bits, block, codes[i], start, end, low, run)


def first_pass(bits, block, codes, start, end, low, run):
    if run > 0:
        return run - 1
    k = start
    while k <= end:
        zeros, size = divmod(bits.symbol(codes), 16)
        if size == 0 and zeros < 15:
            return (1 << zeros) + bits.bits(zeros) - 1
        k += zeros
        if size > 0:
            require(k <= end, "a coefficient behind the last")
            block[k] = bits.signed(size) << low
        k += 1
    return 0


def refining_pass(bits, block, codes, start, end, low, run):
    def refine(k):
        if bits.bit() and not abs(block[k]) >> low & 1:
            block[k] += (1 if block[k] > 0 else -1) << low

    k = start
    while k <= end and run == 0:
        zeros, size = divmod(bits.symbol(codes), 16)
        value = 0
        if size > 0:
            value = (1 if bits.bit() else -1) << low
        elif zeros < 15:
            run = (1 << zeros) + bits.bits(zeros)
            break
        while k <= end:
            if block[k]:
                refine(k)
            elif zeros == 0:
                block[k] = value
                k += 1
                break
            else:
                zeros -= 1
            k += 1
    if run > 0:
        for k in range(k, end + 1):
            if block[k]:
                refine(k)
        run -= 1
    return run


# The baseline file


class BitWriter:
    def __init__(self):
        self.out, self.held, self.count = bytearray(), 0, 0

    def put(self, length, code):
        self.held, self.count = self.held << length | code, self.count + length
        while self.count >= 8:
            self.count -= 8
            byte = self.held >> self.count & 255
            self.out += b"\xff\0" if byte == 255 else bytes([byte])
        self.held &= (1 << self.count) - 1

    def fill(self):
        if self.count:
            self.put(8 - self.count, (1 << (8 - self.count)) - 1)


def write_scan(frame, segment, tables, interval):
    chosen, _ = frame.scan(segment)
    codes = []
    for _, dc, ac in chosen:
        codes.append([{s: (l, code) for l, code, s in reversed(tables.get(key, []))} for key in ((0, dc), (1, ac))])
    bits, before, restarts = BitWriter(), [0] * len(chosen), 0

    def put(table, symbol, value, size):
        require(symbol in table, "a code is missing")
        bits.put(*table[symbol])
        bits.put(size, value if value >= 0 else value + (1 << size) - 1)

    for number, unit in enumerate(frame.units_of(chosen)):
        if interval and number and number % interval == 0:
            bits.fill()
            bits.out += bytes([0xFF, 0xD0 + restarts % 8])
            restarts += 1
            before = [0] * len(chosen)
        for i, block in unit:
            difference = block[0] - before[i]
            before[i] = block[0]
            size = abs(difference).bit_length()
            put(codes[i][0], size, difference, size)
            zeros = 0
            for value in block[1:]:
                if value == 0:
                    zeros += 1
                    continue
                while zeros > 15:
                    put(codes[i][1], 0xF0, 0, 0)
                    zeros -= 16
                size = abs(value).bit_length()
                require(size <= 15, "a coefficient is too large")
                put(codes[i][1], 16 * zeros + size, value, size)
                zeros = 0
            if zeros:
                put(codes[i][1], 0, 0, 0)
    bits.fill()
    return bytes(bits.out)


def apply_recipe(recipe, progressive):
    parts, behind = segments(progressive)
    frame = read_coefficients(parts)
    kept = iter([s for m, s, _ in parts if m in (0xDB, 0xFE, 0xC2) or 0xE0 <= m <= 0xEF])
    out, tables, interval, told = bytearray(b"\xff\xd8"), {}, 0, set()
    place = 0

    def next_kept():
        segment = next(kept, None)
        require(segment is not None, "no segment is left to keep")
        return segment

    def read(count):
        nonlocal place
        require(place + count <= len(recipe), "the recipe is cut")
        place += count
        return recipe[place - count : place]

    def read_segment():
        head = read(4)
        size = int.from_bytes(head[2:], "big")
        require(head[0] == 0xFF and size >= 2, "a segment of the recipe makes no sense")
        return head + read(size - 2)

    while place < len(recipe):
        what = read(1)[0]
        if what == 0:
            out += next_kept()
        elif what == 1:
            marker = read(1)
            out += b"\xff" + marker + next_kept()[2:]
        elif what == 2:
            segment = read_segment()
            out += segment
            if segment[1] == 0xC4:
                huffman_tables(segment, tables)
            elif segment[1] == 0xDD:
                interval = int.from_bytes(segment[4:6], "big")
        elif what == 3:
            segment = read_segment()
            numbers = {c.number for c, _, _ in frame.scan(segment)[0]}
            require(not numbers & told, "a component is told twice")
            told |= numbers
            out += segment + write_scan(frame, segment, tables, interval)
        elif what == 4:
            blocks = [block for c in frame.components for block in c.blocks]
            at = 0
            for _ in range(int.from_bytes(read(4), "little")):
                for count in range(5):
                    byte = read(1)[0]
                    at += (byte & 127) << (7 * count)
                    if byte < 128:
                        break
                require(byte < 128, "a distance is spelt in too many bytes")
                require(at < 64 * len(blocks), "a coefficient that is not there")
                blocks[at // 64][at % 64] = int.from_bytes(read(2), "little", signed=True)
        else:
            raise Damaged("an unknown byte of a recipe")
    return bytes(out) + b"\xff\xd9" + behind
