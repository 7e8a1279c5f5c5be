//! From a progressive file back to the bytes of the baseline file that it was made of.
//!
//! The reconstruction is what the progressive file does not have: Huffman tables, restart intervals, heads of scans, and the order of all segments.
//! The data of scans follow from the coefficients. It is a few hundred bytes, and more where an encoder went on with the picture in
//! blocks that only fill up units: progressive scans leave these out.

use super::frame::{Frame, Item, Parsed, ScanHeader, Tables, stays};
use super::{END, Unsupported, progressive, sequential};
use crate::leb128;

/// The next segment of the progressive file that is no table of a scan.
const SAME: u8 = 0;
/// The same, with this marker instead of that of a progressive frame.
const FRAME: u8 = 1;
/// A segment that follows.
const SEGMENT: u8 = 2;
/// A scan, the segment of which follows.
const SCAN: u8 = 3;

/// Coefficients of blocks that fill up units: their number as four bytes, then for each the distance from the one before in groups of seven
/// bits, the lowest first, and its value.
const FILLING: u8 = 4;

/// The reconstruction of a baseline file.
pub fn reconstruction(parsed: &Parsed<'_>, filling: &[(usize, i16)]) -> Vec<u8> {
    let mut out = Vec::new();
    if !filling.is_empty() {
        out.push(FILLING);
        out.extend_from_slice(&(filling.len() as u32).to_le_bytes());
        let mut before = 0;
        for &(place, value) in filling {
            leb128::put(&mut out, (place - before) as u64);
            out.extend_from_slice(&value.to_le_bytes());
            before = place;
        }
    }
    for item in &parsed.items {
        match *item {
            Item::Segment { marker: marker @ (0xC0 | 0xC1), .. } => out.extend_from_slice(&[FRAME, marker]),
            Item::Segment { marker, .. } if stays(marker) => out.push(SAME),
            Item::Segment { bytes, .. } => {
                out.push(SEGMENT);
                out.extend_from_slice(bytes);
            }
            Item::Scan { header, .. } => {
                out.push(SCAN);
                out.extend_from_slice(header);
            }
        }
    }
    out
}

/// The baseline file that `progressive` was made of by [`cut`](super::cut), with the reconstruction that came with it; takes at most `limit`
/// bytes for coefficients.
///
/// # Errors
/// [`Unsupported`] where the two do not belong together, or one is damaged, or the limit is too low.
pub fn restore(progressive: &[u8], reconstruction: &[u8], limit: u64) -> Result<Vec<u8>, Unsupported> {
    const WRONG: Unsupported = Unsupported("the reconstruction of its bytes does not fit it");
    let parsed = Parsed::new(progressive)?;
    if parsed.process != 0xC2 {
        return Err(WRONG);
    }
    let frame = Frame::new(&parsed, limit)?;
    let mut blocks = progressive::decode(&parsed, &frame)?;
    let mut kept = parsed.items.iter().filter_map(|i| match *i {
        Item::Segment { marker, bytes } if stays(marker) => Some(bytes),
        _ => None,
    });
    let mut out = vec![0xFF, 0xD8];
    let mut tables = Tables::default();
    let mut scanned = vec![false; frame.components.len()];
    let mut at = 0;
    while let Some(&what) = reconstruction.get(at) {
        at += 1;
        // A segment that stands in the reconstruction.
        let told = |at: usize| {
            let length = reconstruction.get(at + 2..at + 4).map(|l| (l[0] as usize) << 8 | l[1] as usize)?;
            reconstruction.get(at..at + 2 + length).filter(|_| length >= 2)
        };
        match what {
            SAME => out.extend_from_slice(kept.next().ok_or(WRONG)?),
            FRAME => {
                out.extend_from_slice(&[0xFF, *reconstruction.get(at).ok_or(WRONG)?]);
                out.extend_from_slice(&kept.next().ok_or(WRONG)?[2..]);
                at += 1;
            }
            SEGMENT => {
                let segment = told(at).ok_or(WRONG)?;
                tables.take(segment[1], segment)?;
                out.extend_from_slice(segment);
                at += segment.len();
            }
            SCAN => {
                let header = told(at).ok_or(WRONG)?;
                // Each component once: a reconstruction must not be short and its file without end.
                for &c in &ScanHeader::new(&frame, header)?.list {
                    if std::mem::replace(&mut scanned[c], true) {
                        return Err(WRONG);
                    }
                }
                out.extend_from_slice(header);
                sequential::encode_scan(&frame, header, &tables, &blocks, &mut out)?;
                at += header.len();
            }
            FILLING => {
                let count = reconstruction.get(at..).and_then(<[u8]>::first_chunk).ok_or(WRONG)?;
                at += 4;
                let mut place = 0u64;
                for _ in 0..u32::from_le_bytes(*count) {
                    let gap = leb128::take(reconstruction, &mut at).ok().flatten().ok_or(WRONG)?;
                    place = place.checked_add(gap).ok_or(WRONG)?;
                    let value = reconstruction.get(at..).and_then(<[u8]>::first_chunk).ok_or(WRONG)?;
                    at += 2;
                    let block =
                        usize::try_from(place / 64).ok().and_then(|block| blocks.get_mut(block)).ok_or(WRONG)?;
                    block[(place % 64) as usize] = i16::from_le_bytes(*value);
                }
            }
            _ => return Err(WRONG),
        }
    }
    out.extend_from_slice(&END);
    out.extend_from_slice(parsed.trailer);
    Ok(out)
}
