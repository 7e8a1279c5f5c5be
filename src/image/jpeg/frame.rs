//! The segments of a JPEG file, its frame, and the order of blocks in scans (T.81, annexes A.2 and B).

use super::Unsupported;
use super::entropy::Code;
use crate::image::signature::is_jpeg;

/// Where coefficients are kept: blocks of 64 in zigzag order, component by component, row by row.
pub type Blocks = Vec<[i16; 64]>;

/// A part of a file.
#[derive(Clone, Copy, Debug)]
pub enum Item<'a> {
    /// A segment, from its marker on.
    Segment { marker: u8, bytes: &'a [u8] },
    /// A scan: its segment, its data, and where these end in the file.
    Scan { header: &'a [u8], data: &'a [u8], end: usize },
}

/// A file taken apart.
#[derive(Debug)]
pub struct Parsed<'a> {
    pub items: Vec<Item<'a>>,
    /// Bytes behind the end marker.
    pub trailer: &'a [u8],
    /// The marker of the frame, which names the process.
    pub process: u8,
    /// The body of the frame's segment.
    pub frame: &'a [u8],
}

/// Whether a segment of this kind belongs to the picture rather than to scans.
pub fn stays(marker: u8) -> bool {
    matches!(marker, 0xDB | 0xE0..=0xEF | 0xFE | 0xC0..=0xC3)
}

impl<'a> Parsed<'a> {
    /// Take a file apart. It has one frame and then scans, and nothing but these and known segments.
    pub fn new(bytes: &'a [u8]) -> Result<Self, Unsupported> {
        const CUT: Unsupported = Unsupported("it is cut: its end marker is missing");
        if !is_jpeg(bytes) {
            return Err(Unsupported::NO_JPEG);
        }
        let mut items = Vec::new();
        let (mut process, mut frame, mut scans) = (0, &[][..], 0);
        let mut at = 2;
        loop {
            if *bytes.get(at).ok_or(CUT)? != 0xFF {
                return Err(Unsupported("it is damaged: bytes between its segments"));
            }
            let mut from = at;
            while *bytes.get(from + 1).ok_or(CUT)? == 0xFF {
                from += 1;
            }
            let marker = bytes[from + 1];
            if marker == 0xD9 {
                if scans == 0 {
                    return Err(Unsupported("it has no scans"));
                }
                return Ok(Parsed { items, trailer: &bytes[from + 2..], process, frame });
            }
            match marker {
                0xC0..=0xC3 | 0xC5..=0xC7 | 0xC9..=0xCB | 0xCD..=0xCF if process == 0 => process = marker,
                0xDA if process != 0 => scans += 1,
                0xC4 | 0xDD | 0xE0..=0xEF | 0xFE => {}
                0xDB if scans == 0 => {}
                0xDB => return Err(Unsupported("its quantization changes between scans")),
                0xCC => return Err(Unsupported("it is arithmetic-coded")),
                0xDC => return Err(Unsupported("it tells its height behind its first scan")),
                0xDE | 0xDF => return Err(Unsupported("it is a hierarchical JPEG")),
                _ => return Err(Unsupported("it is damaged: a segment that does not belong where it is")),
            }
            let [high, low] = [*bytes.get(from + 2).ok_or(CUT)?, *bytes.get(from + 3).ok_or(CUT)?];
            let length = (high as usize) << 8 | low as usize;
            let end = from + 2 + length;
            let segment = bytes.get(from..end).filter(|_| length >= 2).ok_or(CUT)?;
            if marker == process {
                frame = &segment[4..];
            }
            if marker == 0xE2 && segment[4..].starts_with(b"MPF\0") {
                return Err(Unsupported("it holds several pictures, which find each other by their place in the file"));
            }
            at = end;
            if marker == 0xDA {
                // Data go on up to a marker that is no restart.
                loop {
                    let rest = bytes.get(at..).ok_or(CUT)?;
                    at += rest.iter().position(|&b| b == 0xFF).ok_or(CUT)?;
                    match bytes.get(at + 1).ok_or(CUT)? {
                        0 | 0xD0..=0xD7 => at += 2,
                        _ => break,
                    }
                }
                items.push(Item::Scan { header: segment, data: &bytes[end..at], end: at });
            } else {
                items.push(Item::Segment { marker, bytes: segment });
            }
        }
    }

    /// Bytes of all scans.
    pub fn coded_bytes(&self) -> usize {
        self.items.iter().map(|i| if let Item::Scan { data, .. } = i { data.len() } else { 0 }).sum()
    }

    /// Whether its components say that they are red, green and blue.
    pub fn is_rgb(&self) -> bool {
        let ids: Vec<u8> = self.frame.get(6..).unwrap_or_default().chunks_exact(3).map(|c| c[0]).collect();
        let adobe = |bytes: &[u8]| bytes[4..].starts_with(b"Adobe") && bytes.get(15) == Some(&0);
        ids == *b"RGB" || self.items.iter().any(|i| matches!(i, Item::Segment { marker: 0xEE, bytes } if adobe(bytes)))
    }
}

/// A component of a frame.
#[derive(Debug)]
pub struct Component {
    id: u8,
    h: usize,
    v: usize,
    /// Blocks that hold samples, across and down.
    across: usize,
    down: usize,
    /// Blocks in a row as stored, with those that fill up the last unit.
    stride: usize,
    rows: usize,
    /// Its first block.
    first: usize,
}

/// The layout of a picture.
#[derive(Debug)]
pub struct Frame {
    pub components: Vec<Component>,
    units_across: usize,
    units_down: usize,
}

impl Frame {
    /// The frame of a file, if its coefficients take at most `limit` bytes.
    pub fn new(parsed: &Parsed<'_>, limit: u64) -> Result<Self, Unsupported> {
        const WRONG: Unsupported = Unsupported("it is damaged: its frame makes no sense");
        let b = parsed.frame;
        let &[precision, y1, y0, x1, x0, count, ref rest @ ..] = b else { return Err(WRONG) };
        if precision != 8 {
            return Err(Unsupported("it has more than 8 bits per sample"));
        }
        let [height, width] = [[y1, y0], [x1, x0]].map(|[a, b]| (a as usize) << 8 | b as usize);
        if height == 0 {
            return Err(Unsupported("it tells its height behind its first scan"));
        }
        if width == 0 || !(1..=4).contains(&count) || rest.len() != 3 * count as usize {
            return Err(WRONG);
        }
        let sampling: Vec<[usize; 2]> =
            rest.chunks_exact(3).map(|c| [(c[1] >> 4) as usize, (c[1] & 15) as usize]).collect();
        if sampling.iter().flatten().any(|s| !(1..=4).contains(s)) {
            return Err(WRONG);
        }
        let [h_most, v_most] = [0, 1].map(|k| sampling.iter().map(|s| s[k]).max().unwrap_or(1));
        let (units_across, units_down) = (width.div_ceil(8 * h_most), height.div_ceil(8 * v_most));
        let (mut components, mut first) = (Vec::<Component>::new(), 0);
        for (c, &[h, v]) in rest.chunks_exact(3).zip(&sampling) {
            if components.iter().any(|other| other.id == c[0]) {
                return Err(WRONG);
            }
            let (stride, rows) = (units_across * h, units_down * v);
            components.push(Component {
                id: c[0],
                h,
                v,
                across: (width * h).div_ceil(h_most).div_ceil(8),
                down: (height * v).div_ceil(v_most).div_ceil(8),
                stride,
                rows,
                first,
            });
            first += stride * rows;
        }
        let frame = Frame { components, units_across, units_down };
        if frame.bytes() > limit {
            return Err(Unsupported("its coefficients take more memory than is allowed"));
        }
        Ok(frame)
    }

    /// The number of the component with this name.
    pub fn number(&self, id: u8) -> Option<usize> {
        self.components.iter().position(|c| c.id == id)
    }

    /// Blocks that hold samples.
    pub fn blocks(&self) -> usize {
        self.components.iter().map(|c| c.across * c.down).sum()
    }

    /// Bytes of all coefficients.
    pub fn bytes(&self) -> u64 {
        self.components.iter().map(|c| (c.stride * c.rows * size_of::<[i16; 64]>()) as u64).sum()
    }

    /// All blocks, empty.
    pub fn empty(&self) -> Blocks {
        vec![[0; 64]; self.components.iter().map(|c| c.stride * c.rows).sum()]
    }

    /// Whether one scan can hold these components.
    pub fn interleaves(&self, list: &[usize]) -> bool {
        list.len() == 1 || list.iter().map(|&c| self.components[c].h * self.components[c].v).sum::<usize>() <= 10
    }

    /// Visit the blocks of a scan of the components `list`, in order: the number of the unit, which of the components, the block.
    pub fn visit(
        &self,
        list: &[usize],
        mut visit: impl FnMut(usize, usize, usize) -> Result<(), Unsupported>,
    ) -> Result<(), Unsupported> {
        if let &[c] = list {
            let c = &self.components[c];
            for y in 0..c.down {
                for x in 0..c.across {
                    visit(y * c.across + x, 0, c.first + y * c.stride + x)?;
                }
            }
            return Ok(());
        }
        for unit in 0..self.units_across * self.units_down {
            let (uy, ux) = (unit / self.units_across, unit % self.units_across);
            for (k, &c) in list.iter().enumerate() {
                let c = &self.components[c];
                for y in 0..c.v {
                    for x in 0..c.h {
                        visit(unit, k, c.first + (uy * c.v + y) * c.stride + ux * c.h + x)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Blocks of a component that hold samples, across and down.
    #[cfg(feature = "recompress")]
    pub fn size(&self, component: usize) -> (usize, usize) {
        let c = &self.components[component];
        (c.across, c.down)
    }

    /// Visit all blocks of a component, those that fill up units too: column, row, block.
    #[cfg(feature = "recompress")]
    pub fn each_block(&self, component: usize, mut visit: impl FnMut(usize, usize, usize)) {
        let c = &self.components[component];
        (0..c.rows).for_each(|y| (0..c.stride).for_each(|x| visit(x, y, c.first + y * c.stride + x)));
    }

    /// Take all but the first coefficient from the blocks that fill up units: only these first ones stand in scans of every kind. Returns
    /// what was there, by place in all coefficients.
    pub fn take_filling(&self, blocks: &mut Blocks) -> Vec<(usize, i16)> {
        let mut out = Vec::new();
        for c in &self.components {
            for y in 0..c.rows {
                let from = if y < c.down { c.across } else { 0 };
                for x in from..c.stride {
                    let at = c.first + y * c.stride + x;
                    for (k, value) in blocks[at].iter_mut().enumerate().skip(1).filter(|(_, v)| **v != 0) {
                        out.push((at * 64 + k, std::mem::take(value)));
                    }
                }
            }
        }
        out
    }

    /// The segment of a scan: components with their tables, 0 or 1; the coefficients; the bits.
    pub fn scan_header(&self, list: &[(usize, u8)], [from, to]: [u8; 2], [high, low]: [u8; 2]) -> Vec<u8> {
        let mut out = vec![0xFF, 0xDA, 0, 6 + 2 * list.len() as u8, list.len() as u8];
        for &(c, table) in list {
            out.extend_from_slice(&[self.components[c].id, table << 4 | table]);
        }
        out.extend_from_slice(&[from, to, high << 4 | low]);
        out
    }
}

/// What the segment of a scan says.
pub struct ScanHeader {
    /// Numbers of its components.
    pub list: Vec<usize>,
    /// Their tables for first and for other coefficients.
    pub tables: Vec<[usize; 2]>,
    /// The first and the last coefficient.
    pub from: usize,
    pub to: usize,
    /// The lowest bit before, and now.
    pub high: u32,
    pub low: u32,
}

impl ScanHeader {
    pub fn new(frame: &Frame, header: &[u8]) -> Result<Self, Unsupported> {
        const WRONG: Unsupported = Unsupported("it is damaged: the head of a scan makes no sense");
        let Some((&count, rest)) = header.get(4..).and_then(<[u8]>::split_first) else { return Err(WRONG) };
        let Some((pairs, &[from, to, bits])) = rest.split_at_checked(2 * count as usize) else { return Err(WRONG) };
        let (mut list, mut tables) = (Vec::new(), Vec::new());
        for pair in pairs.chunks_exact(2) {
            let c = frame.number(pair[0]).ok_or(WRONG)?;
            // In the order of the frame, each once.
            if list.last().is_some_and(|&before| before >= c) {
                return Err(WRONG);
            }
            list.push(c);
            tables.push([(pair[1] >> 4) as usize, (pair[1] & 15) as usize]);
        }
        let (from, to, high, low) = (from as usize, to as usize, bits as u32 >> 4, bits as u32 & 15);
        let fits = from <= to && to < 64 && tables.iter().flatten().all(|&t| t < 4) && low < 14 && high < 14;
        if list.is_empty() || !frame.interleaves(&list) || !fits {
            return Err(WRONG);
        }
        Ok(ScanHeader { list, tables, from, to, high, low })
    }
}

/// Huffman tables and restarts, as segments set them.
#[derive(Default)]
pub struct Tables {
    codes: [[Option<Code>; 4]; 2],
    /// Units between restart markers, 0 for none.
    pub restart: usize,
}

impl Tables {
    /// Take up a segment; those that say nothing of tables are passed over.
    pub fn take(&mut self, marker: u8, bytes: &[u8]) -> Result<(), Unsupported> {
        const WRONG: Unsupported = Unsupported("it is damaged: a segment of tables makes no sense");
        let mut body = bytes.get(4..).ok_or(WRONG)?;
        match marker {
            0xDD => match *body {
                [high, low] => self.restart = (high as usize) << 8 | low as usize,
                _ => return Err(WRONG),
            },
            0xC4 => {
                while let Some((&[which, ref counts @ ..], rest)) = body.split_first_chunk::<17>() {
                    let counts: [u8; 16] = std::array::from_fn(|k| counts[k]);
                    let total = counts.iter().map(|&c| c as usize).sum::<usize>();
                    let (symbols, rest) = rest.split_at_checked(total).filter(|_| total <= 256).ok_or(WRONG)?;
                    let slot = self.codes.get_mut(which as usize >> 4).and_then(|c| c.get_mut(which as usize & 15));
                    *slot.ok_or(WRONG)? = Some(Code::new(counts, symbols)?);
                    body = rest;
                }
                if !body.is_empty() {
                    return Err(WRONG);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// The table of a class, 0 for first and 1 for other coefficients.
    pub fn code(&self, class: usize, number: usize) -> Result<&Code, Unsupported> {
        self.codes[class][number].as_ref().ok_or(Unsupported("it is damaged: a Huffman table that it uses is missing"))
    }
}
