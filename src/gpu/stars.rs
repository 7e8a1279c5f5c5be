//! A level as words for the device: a record for each vertex, and its star.
//!
//! Stars are flat: the vertices around the apex, each once and in the order in which the elements name them, how each is
//! joined to the apex, and the fans of triangles as places among those vertices. The processor makes them once for each vertex;
//! the kernel reads them once for each edge and searches little. The layout stands in `shaders/level.wgsl`.

use crate::encode::cost::{Side, WeighInput};

use super::shader::{
    FAN_NONE, FAN_POLYGON, FAN_STRING, RING, STAR_BORDER, STAR_FAR, STAR_POLYGONS, STAR_TOO_LARGE, STARS, TRIANGLES,
};

/// Vertices must be below this on the device.
pub const MOST_VERTICES: usize = 1 << 31;

/// Records and stars of some vertices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stars {
    /// The bits of three coordinates, and the place of the star from where `words` begins.
    pub records: Vec<[u32; 4]>,
    /// The stars.
    pub words: Vec<[u32; 2]>,
}

impl Stars {
    /// Append vertex `v`; `number` says what the device calls a vertex.
    pub fn push(&mut self, level: &WeighInput, v: u32, side: &mut Side, mut number: impl FnMut(u32) -> u32) {
        self.push_record(level, v);
        // What no kernel takes is not even read: hubs cost as much as they have corners.
        if level.star.get(v).len() > STARS {
            self.words.push([STAR_TOO_LARGE, 0]);
            return;
        }
        side.read(level.faces, level.star, level.positions, v);
        let (n, fans) = (side.vertices.len(), side.fans.len());
        if side.too_large || n > RING || fans > TRIANGLES {
            self.words.push([STAR_TOO_LARGE, 0]);
            return;
        }
        let mut head = (n | fans << 8) as u32;
        head |= if side.border { STAR_BORDER } else { 0 };
        head |= if side.polygons { STAR_POLYGONS } else { 0 };
        self.words.push([head, 0]);
        for (i, &x) in side.vertices.iter().enumerate() {
            let faces = side.faces[i];
            let far = if side.far.contains(&(i as u16)) { STAR_FAR } else { 0 };
            self.words.push([number(x), (faces + side.strings[i]) | faces << 8 | far]);
        }
        let mut half: Option<u32> = None;
        for e in &side.elements {
            let fans = &side.fans[e.from as usize..e.to as usize];
            for &[p, q] in fans {
                let kind = match fans.len() {
                    _ if p == q => FAN_STRING,
                    1 => 0,
                    _ => FAN_POLYGON,
                };
                let [p, q, next, previous] = [p, q, e.next, e.previous].map(u32::from);
                let fan = p | q << 6 | next << 12 | previous << 18 | kind << 30;
                match half.take() {
                    Some(first) => self.words.push([first, fan]),
                    None => half = Some(fan),
                }
            }
        }
        if let Some(first) = half {
            self.words.push([first, FAN_NONE << 30]);
        }
    }

    /// Append a vertex whose star nobody asks for.
    pub fn push_record(&mut self, level: &WeighInput, v: u32) {
        let [x, y, z] = level.positions[v as usize].map(f32::to_bits);
        self.records.push([x, y, z, self.words.len() as u32]);
    }

    /// Bytes of the larger of the two lists, and of both.
    pub fn bytes(&self) -> (u64, u64) {
        let (records, words) = (self.records.len() as u64 * 16, self.words.len() as u64 * 8);
        (records.max(words), records + words)
    }
}

/// About what a level takes: bytes of records, and of stars.
pub fn bytes_of(level: &WeighInput) -> (u64, u64) {
    // A head, and a vertex more than fans at borders. Around an inner vertex there is one vertex for each fan.
    let mut words = 2 * level.positions.len() as u64;
    for ends in level.faces.start.windows(2) {
        let degree = u64::from(ends[1] - ends[0]);
        // Around larger ones stars are too large.
        if degree <= RING as u64 {
            let fans = degree * degree.saturating_sub(2).max(1);
            words += fans + fans / 2;
        }
    }
    (16 * level.positions.len() as u64, 8 * words)
}
