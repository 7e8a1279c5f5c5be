"""Texts of materials and images, pieces, previews. docs/format: Appearance and images."""

from types import SimpleNamespace

from arithmetic import Damaged, leb128, require
from range_coder import Models


class Texts:
    def __init__(self, rc):
        self.rc, self.before, self.size = rc, 0, 0
        self.C, self.N, self.byte = Models("C"), Models("N"), Models("byte")
        self.texts = 0

    def text(self):
        count = self.rc.golomb(self.N)
        self.size += count
        self.texts += 1
        require(self.size <= 1 << 26 and self.texts <= 1 << 20, "too many texts")
        text = bytearray()
        for _ in range(count):
            node = 1
            for _ in range(8):
                node = 2 * node + self.rc.bit(self.byte, self.before, node)
            self.before = node - 256
            text.append(self.before)
        try:
            return text.decode()
        except UnicodeDecodeError:
            raise Damaged("a text is not UTF-8")

    def list(self, name):
        self.rc.mark(name)
        count = self.rc.golomb(self.C)
        require(self.texts + count <= 1 << 20, "too many texts")
        return [self.text() for _ in range(count)]


def read_appearance(rc, front):
    texts = Texts(rc)
    result = SimpleNamespace()
    result.materials, result.textures = texts.list("materials"), texts.list("textures")
    result.samplers = texts.list("samplers")
    rc.mark("images")
    count = rc.golomb(texts.C)
    require(count <= 1 << 20, "too many texts")
    result.images = []
    for _ in range(count):
        name = texts.text()
        result.images.append(SimpleNamespace(name=name, mime=texts.text(), file=b"", previews=[]))
    require(len(result.materials) == front.materials, "not the materials that the tables say")
    require(len(result.images) == front.images, "not the images that the tables say")
    return result


def read_preview(payload, appearance, begun):
    """Adds a preview to its image; one that is not sound is passed over. `begun`: images of which a piece was there."""
    try:
        image, place = leb128(payload, 0)
        number, place = leb128(payload, place)
    except Damaged:
        return
    file = payload[place:]
    if max(image, number) >= 1 << 32 or appearance is None or image >= len(appearance.images) or image in begun:
        return
    if not (file.startswith(b"\xff\xd8\xff") or file.startswith(b"\x89PNG")):
        return
    previews = appearance.images[image].previews
    if not previews or previews[-1][0] < number:
        previews.append((number, file))
