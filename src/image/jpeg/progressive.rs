//! Scans of progressive files: a band of coefficients, a bit at a time (T.81, annex G).

use super::Unsupported;
use super::entropy::{Code, Pen, Reader, Sink, Tally, Writer, sized};
use super::frame::{Blocks, Frame, Item, Parsed, ScanHeader, Tables};

/// A scan to be written: components, coefficients, lowest bit before and now.
struct Scan {
    list: Vec<usize>,
    band: [u8; 2],
    bits: [u8; 2],
}

/// The scans of a picture, coarse before fine. First coefficients come whole: their last bit, which is not compressed where it comes
/// alone, costs up to a fifth of a smooth picture. The last bit of the others, up to half of a fine one, comes in two bands.
fn script(frame: &Frame, rgb: bool) -> Vec<Scan> {
    let all: Vec<usize> = (0..frame.components.len()).collect();
    let band = |c: usize, band, bits| Scan { list: vec![c], band, bits };
    let lists = if frame.interleaves(&all) { vec![all.clone()] } else { all.iter().map(|&c| vec![c]).collect() };
    let mut out: Vec<Scan> = lists.into_iter().map(|list| Scan { list, band: [0, 0], bits: [0, 0] }).collect();
    if all.len() == 3 && !rgb {
        // Luma first and last: the eye sees it best, and it is most of the bytes.
        out.extend([band(0, [1, 8], [0, 2]), band(2, [1, 63], [0, 1]), band(1, [1, 63], [0, 1])]);
        out.extend([band(0, [9, 63], [0, 2]), band(0, [1, 63], [2, 1])]);
        out.extend([band(2, [1, 63], [1, 0]), band(1, [1, 63], [1, 0])]);
        out.extend([band(0, [1, 14], [1, 0]), band(0, [15, 63], [1, 0])]);
    } else {
        for (of, bits) in
            [([1, 8], [0, 2]), ([9, 63], [0, 2]), ([1, 63], [2, 1]), ([1, 14], [1, 0]), ([15, 63], [1, 0])]
        {
            out.extend(all.iter().map(|&c| band(c, of, bits)));
        }
    }
    out
}

/// Append all scans, each behind the tables that suit it best.
pub fn encode(frame: &Frame, blocks: &Blocks, rgb: bool, out: &mut Vec<u8>) {
    for scan in script(frame, rgb) {
        let mut tally = Tally([[0; 256]; 2]);
        write_scan(frame, &scan, blocks, &mut tally);
        let codes = tally.0.each_ref().map(Code::best);
        let class = if scan.band[0] == 0 { 0 } else { 0x10 };
        for (k, code) in codes.iter().enumerate().filter(|(_, code)| !code.symbols.is_empty()) {
            out.extend_from_slice(&[0xFF, 0xC4]);
            out.extend_from_slice(&(19 + code.symbols.len() as u16).to_be_bytes());
            out.push(class | k as u8);
            out.extend_from_slice(&code.counts);
            out.extend_from_slice(&code.symbols);
        }
        let list: Vec<(usize, u8)> = scan.list.iter().map(|&c| (c, table(c) as u8)).collect();
        out.extend_from_slice(&frame.scan_header(&list, scan.band, scan.bits));
        let mut pen = Pen { codes, out: Writer::onto(std::mem::take(out)) };
        write_scan(frame, &scan, blocks, &mut pen);
        pen.out.pad();
        *out = pen.out.out;
    }
}

/// The table of a component: one for luma, one for all others.
fn table(component: usize) -> usize {
    usize::from(component > 0)
}

fn write_scan<S: Sink>(frame: &Frame, scan: &Scan, blocks: &Blocks, sink: &mut S) {
    let [from, to] = scan.band.map(usize::from);
    let low = scan.bits[1] as u32;
    let mut before = [0i32; 4];
    let mut band = Band { table: table(scan.list[0]), blocks: 0, later: Vec::new() };
    // The visitor never fails.
    let _ = frame.visit(&scan.list, |_, k, at| {
        let block = &blocks[at];
        match (from, scan.bits[0]) {
            (0, _) => {
                let value = block[0] as i32;
                let (n, bits) = sized(value - before[k]);
                before[k] = value;
                sink.symbol(table(scan.list[k]), n as u8);
                sink.bits(bits, n);
            }
            (_, 0) => band.first(sink, &block[from..=to], low),
            _ => band.refine(sink, &block[from..=to], low),
        }
        Ok(())
    });
    band.end(sink);
}

/// A band on its way out: blocks that have come to their end, and bits that follow the symbol that says so.
struct Band {
    table: usize,
    blocks: u32,
    later: Vec<u8>,
}

impl Band {
    fn end<S: Sink>(&mut self, sink: &mut S) {
        if self.blocks > 0 {
            let n = self.blocks.ilog2();
            sink.symbol(self.table, (n << 4) as u8);
            sink.bits(self.blocks & ((1 << n) - 1), n);
            self.blocks = 0;
        }
        self.later.drain(..).for_each(|bit| sink.bits(bit as u32, 1));
    }

    /// Coefficients that are not known yet (G.1.2.2).
    fn first<S: Sink>(&mut self, sink: &mut S, band: &[i16], low: u32) {
        let mut zeros = 0u32;
        for &value in band {
            let size = (value.unsigned_abs() >> low) as i32;
            if size == 0 {
                zeros += 1;
                continue;
            }
            self.end(sink);
            while zeros > 15 {
                sink.symbol(self.table, 0xF0);
                zeros -= 16;
            }
            let (n, bits) = sized(if value < 0 { -size } else { size });
            sink.symbol(self.table, (zeros << 4 | n) as u8);
            sink.bits(bits, n);
            zeros = 0;
        }
        if zeros > 0 {
            self.blocks += 1;
            if self.blocks == 0x7FFF {
                self.end(sink);
            }
        }
    }

    /// One more bit of coefficients, and those that begin with it (G.1.2.3).
    fn refine<S: Sink>(&mut self, sink: &mut S, band: &[i16], low: u32) {
        let size = |value: &i16| value.unsigned_abs() >> low;
        let last = band.iter().rposition(|v| size(v) == 1);
        let mut zeros = 0u32;
        let mut corrections = Vec::new();
        for (k, value) in band.iter().enumerate() {
            let now = size(value);
            if now == 0 {
                zeros += 1;
                continue;
            }
            while zeros > 15 && last.is_some_and(|last| k <= last) {
                self.end(sink);
                sink.symbol(self.table, 0xF0);
                corrections.drain(..).for_each(|bit: u8| sink.bits(bit as u32, 1));
                zeros -= 16;
            }
            if now > 1 {
                corrections.push((now & 1) as u8);
                continue;
            }
            self.end(sink);
            sink.symbol(self.table, (zeros << 4 | 1) as u8);
            sink.bits(u32::from(*value > 0), 1);
            corrections.drain(..).for_each(|bit| sink.bits(bit as u32, 1));
            zeros = 0;
        }
        if zeros > 0 || !corrections.is_empty() {
            self.blocks += 1;
            self.later.append(&mut corrections);
            // Decoders need not hold more than 1000 bits; they would not mind.
            if self.blocks == 0x7FFF || self.later.len() > 937 {
                self.end(sink);
            }
        }
    }
}

/// More scans than any file of ours has: each of them visits all blocks, however few bytes it has.
const MOST_SCANS: usize = 64;

/// The coefficients of a progressive file.
pub fn decode(parsed: &Parsed<'_>, frame: &Frame) -> Result<Blocks, Unsupported> {
    if parsed.items.iter().filter(|i| matches!(i, Item::Scan { .. })).count() > MOST_SCANS {
        return Err(Unsupported("it has more than 64 scans"));
    }
    let mut blocks = frame.empty();
    let mut tables = Tables::default();
    for item in &parsed.items {
        match *item {
            Item::Segment { marker, bytes } => tables.take(marker, bytes)?,
            Item::Scan { header, data, .. } => {
                let head = ScanHeader::new(frame, header)?;
                decode_scan(frame, &head, &tables, data, &mut blocks)?;
            }
        }
    }
    Ok(blocks)
}

const RANGE: Unsupported = Unsupported("it is damaged: a coefficient out of range");

fn decode_scan(
    frame: &Frame,
    head: &ScanHeader,
    tables: &Tables,
    data: &[u8],
    blocks: &mut Blocks,
) -> Result<(), Unsupported> {
    let first = head.high == 0;
    if (head.from == 0) != (head.to == 0)
        || (head.from > 0 && head.list.len() > 1)
        || (!first && head.high != head.low + 1)
    {
        return Err(Unsupported("it is damaged: the head of a scan makes no sense"));
    }
    let class = usize::from(head.from > 0);
    let codes: Vec<Option<&Code>> = if class == 0 && !first {
        vec![None; head.list.len()]
    } else {
        head.tables.iter().map(|t| Ok(Some(tables.code(class, t[class])?))).collect::<Result<_, Unsupported>>()?
    };
    let mut reader = Reader::new(data);
    let mut before = [0i32; 4];
    let (mut unit_before, mut skip) = (0, 0u32);
    frame.visit(&head.list, |unit, k, at| {
        if unit != unit_before {
            unit_before = unit;
            if tables.restart > 0 && unit % tables.restart == 0 {
                reader.restart((unit / tables.restart - 1) as u32)?;
                (before, skip) = ([0; 4], 0);
            }
        }
        let block = &mut blocks[at];
        match (codes[k], class, first) {
            (Some(code), 0, _) => {
                let n = reader.symbol(code)? as u32;
                if n > 11 {
                    return Err(RANGE);
                }
                before[k] = before[k].saturating_add(reader.signed(n)?);
                block[0] = i16::try_from(before[k].checked_shl(head.low).ok_or(RANGE)?).map_err(|_| RANGE)?;
                Ok(())
            }
            (None, ..) => {
                block[0] |= (reader.bits(1)? << head.low) as i16;
                Ok(())
            }
            (Some(code), _, true) => {
                first_bits(&mut reader, code, &mut block[head.from..=head.to], head.low, &mut skip)
            }
            (Some(code), _, false) => next_bit(&mut reader, code, &mut block[head.from..=head.to], head.low, &mut skip),
        }
    })?;
    reader.end()
}

fn first_bits(
    reader: &mut Reader<'_>,
    code: &Code,
    band: &mut [i16],
    low: u32,
    skip: &mut u32,
) -> Result<(), Unsupported> {
    if *skip > 0 {
        *skip -= 1;
        return Ok(());
    }
    let mut i = 0;
    while i < band.len() {
        let symbol = reader.symbol(code)?;
        let (zeros, n) = (symbol as usize >> 4, symbol as u32 & 15);
        if n == 0 && zeros < 15 {
            *skip = (1 << zeros) - 1 + reader.bits(zeros as u32)?;
            return Ok(());
        }
        i += zeros;
        if n > 0 {
            let value = reader.signed(n)? << low;
            *band.get_mut(i).ok_or(RANGE)? = i16::try_from(value).map_err(|_| RANGE)?;
        }
        i += 1;
    }
    if i > band.len() { Err(RANGE) } else { Ok(()) }
}

fn next_bit(
    reader: &mut Reader<'_>,
    code: &Code,
    band: &mut [i16],
    low: u32,
    skip: &mut u32,
) -> Result<(), Unsupported> {
    let refine = |reader: &mut Reader<'_>, value: &mut i16| {
        if reader.bits(1)? == 1 {
            let step = if *value < 0 { -1i16 } else { 1 } << low;
            *value = value.checked_add(step).ok_or(RANGE)?;
        }
        Ok::<(), Unsupported>(())
    };
    let mut i = 0;
    while *skip == 0 && i < band.len() {
        let symbol = reader.symbol(code)?;
        let (mut zeros, n) = (symbol >> 4, symbol & 15);
        let new = match n {
            0 if zeros < 15 => {
                *skip = (1 << zeros) + reader.bits(zeros as u32)?;
                break;
            }
            0 => 0,
            1 => (if reader.bits(1)? == 1 { 1i16 } else { -1 }) << low,
            _ => return Err(RANGE),
        };
        loop {
            let value = band.get_mut(i).ok_or(RANGE)?;
            i += 1;
            if *value != 0 {
                refine(reader, value)?;
            } else if zeros == 0 {
                *value = new;
                break;
            } else {
                zeros -= 1;
            }
        }
    }
    if *skip > 0 {
        *skip -= 1;
        for value in band[i..].iter_mut().filter(|v| **v != 0) {
            refine(reader, value)?;
        }
    }
    Ok(())
}
