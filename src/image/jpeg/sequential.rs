//! Scans of baseline files: all coefficients of a block at once (T.81, annex F).

use super::Unsupported;
use super::entropy::{Reader, Writer, sized};
use super::frame::{Blocks, Frame, Item, Parsed, ScanHeader, Tables};

/// The largest first coefficient: eleven bits tell its difference from the one before.
const LARGEST: i32 = 2047;

/// The coefficients of a file; every component has to come in one scan.
pub fn decode(parsed: &Parsed<'_>, frame: &Frame) -> Result<Blocks, Unsupported> {
    let mut blocks = frame.empty();
    let mut tables = Tables::default();
    let mut seen = vec![false; frame.components.len()];
    for item in &parsed.items {
        match *item {
            Item::Segment { marker, bytes } => tables.take(marker, bytes)?,
            Item::Scan { header, data, .. } => {
                let head = header_of(frame, header)?;
                for &c in &head.list {
                    if std::mem::replace(&mut seen[c], true) {
                        return Err(Unsupported("it tells a component twice"));
                    }
                }
                decode_scan(frame, &head, &tables, data, &mut blocks)?;
            }
        }
    }
    if seen.contains(&false) {
        return Err(Unsupported("it is damaged: a component without a scan"));
    }
    Ok(blocks)
}

fn header_of(frame: &Frame, header: &[u8]) -> Result<ScanHeader, Unsupported> {
    let head = ScanHeader::new(frame, header)?;
    if (head.from, head.to, head.high, head.low) != (0, 63, 0, 0) {
        return Err(Unsupported("it is damaged: a progressive scan in a baseline file"));
    }
    Ok(head)
}

fn decode_scan(
    frame: &Frame,
    head: &ScanHeader,
    tables: &Tables,
    data: &[u8],
    blocks: &mut Blocks,
) -> Result<(), Unsupported> {
    let codes: Vec<_> = head
        .tables
        .iter()
        .map(|&[a, b]| Ok([tables.code(0, a)?, tables.code(1, b)?]))
        .collect::<Result<_, Unsupported>>()?;
    let mut reader = Reader::new(data);
    let mut before = [0i32; 4];
    let mut unit_before = 0;
    frame.visit(&head.list, |unit, k, at| {
        if unit != unit_before {
            unit_before = unit;
            if tables.restart > 0 && unit % tables.restart == 0 {
                reader.restart((unit / tables.restart - 1) as u32)?;
                before = [0; 4];
            }
        }
        let [first, others] = codes[k];
        let block = &mut blocks[at];
        let n = reader.symbol(first)? as u32;
        if n > 11 {
            return Err(Unsupported("it is damaged: a coefficient out of range"));
        }
        before[k] += reader.signed(n)?;
        if before[k].abs() > LARGEST {
            return Err(Unsupported("it is damaged: a coefficient out of range"));
        }
        block[0] = before[k] as i16;
        let mut i = 1;
        while i < 64 {
            let symbol = reader.symbol(others)?;
            let (zeros, n) = (symbol as usize >> 4, symbol as u32 & 15);
            match (zeros, n) {
                (0, 0) => break,
                (15, 0) => i += 16,
                (_, 1..=10) if i + zeros < 64 => {
                    block[i + zeros] = reader.signed(n)? as i16;
                    i += zeros + 1;
                }
                _ => return Err(Unsupported("it is damaged: a coefficient out of range")),
            }
        }
        if i > 64 { Err(Unsupported("it is damaged: a block of too many coefficients")) } else { Ok(()) }
    })?;
    reader.end()
}

/// Write the data of a scan with the tables at hand, as encoders usually do; refuses what these tables have no codes for.
pub fn encode_scan(
    frame: &Frame,
    header: &[u8],
    tables: &Tables,
    blocks: &Blocks,
    out: &mut Vec<u8>,
) -> Result<(), Unsupported> {
    let head = header_of(frame, header)?;
    let codes: Vec<_> = head
        .tables
        .iter()
        .map(|&[a, b]| Ok([tables.code(0, a)?, tables.code(1, b)?]))
        .collect::<Result<_, Unsupported>>()?;
    let mut writer = Writer::onto(std::mem::take(out));
    let mut before = [0i32; 4];
    let mut unit_before = 0;
    let mut known = true;
    frame.visit(&head.list, |unit, k, at| {
        if unit != unit_before {
            unit_before = unit;
            if tables.restart > 0 && unit % tables.restart == 0 {
                writer.pad();
                writer.out.extend_from_slice(&[0xFF, 0xD0 | (unit / tables.restart - 1 & 7) as u8]);
                before = [0; 4];
            }
        }
        let [first, others] = codes[k];
        let block = &blocks[at];
        let (n, bits) = sized(block[0] as i32 - before[k]);
        before[k] = block[0] as i32;
        known &= n < 16 && first.write(&mut writer, n as u8);
        writer.put(bits, n);
        let mut zeros = 0u8;
        for &value in &block[1..] {
            if value == 0 {
                zeros += 1;
                continue;
            }
            while zeros > 15 {
                known &= others.write(&mut writer, 0xF0);
                zeros -= 16;
            }
            let (n, bits) = sized(value as i32);
            known &= n < 16 && others.write(&mut writer, zeros << 4 | n as u8 & 15);
            writer.put(bits, n);
            zeros = 0;
        }
        if zeros > 0 {
            known &= others.write(&mut writer, 0);
        }
        if known { Ok(()) } else { Err(Unsupported("a coefficient without a code")) }
    })?;
    writer.pad();
    *out = writer.out;
    Ok(())
}
