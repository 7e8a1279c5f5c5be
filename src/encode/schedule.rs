//! In what order the chunks of mesh and images stand in a file.
//!
//! Level 0, the materials and the coarsest preview of each image come first in any order: previews are tiny, and nothing says sooner what a
//! model looks like. A reconstruction, which adds nothing to be seen, comes last. Finer previews and pieces of several images take turns, each as far through its bytes as the others, so that none is sharp while another has not begun.

use crate::format::container::{Chunk, Kind};
use std::fmt;
use std::str::FromStr;

/// What comes first, the mesh or its images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Schedule {
    /// All levels, then the images; only their first previews stand in front.
    #[default]
    MeshFirst,
    /// Level 0, the images, then the other levels.
    TextureFirst,
    /// Levels and pieces of images in turns, each as far through its bytes as the other.
    Linear,
}

impl Schedule {
    /// All of them.
    pub const ALL: [Schedule; 3] = [Schedule::MeshFirst, Schedule::TextureFirst, Schedule::Linear];
}

impl fmt::Display for Schedule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Schedule::MeshFirst => "mesh-first",
            Schedule::TextureFirst => "texture-first",
            Schedule::Linear => "linear",
        })
    }
}

impl FromStr for Schedule {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Schedule::ALL
            .into_iter()
            .find(|s| s.to_string() == name)
            .ok_or_else(|| format!("{name:?} is no order of chunks; use mesh-first, texture-first or linear"))
    }
}

/// Chunks that stay together.
type Group<B> = Vec<Chunk<B>>;

/// The chunks of all that belongs to no level.
pub struct Pictures<B> {
    /// The materials.
    pub appearance: Option<Chunk<B>>,
    /// The previews of each image, coarse before fine.
    pub previews: Vec<Group<B>>,
    /// The pieces of each image.
    pub images: Vec<Group<B>>,
    pub reconstructions: Vec<Chunk<B>>,
}

/// The chunks of a file in order. `mesh` holds those of levels in their order, the base first; the levels that chunks of pictures stand behind
/// are set here.
pub fn order<B: AsRef<[u8]>>(mesh: Vec<Chunk<B>>, pictures: Pictures<B>, schedule: Schedule) -> Vec<Chunk<B>> {
    let Pictures { appearance, previews, images, reconstructions } = pictures;
    let mut levels: Vec<Group<B>> = Vec::new();
    for chunk in mesh {
        match levels.last_mut() {
            Some(group) if chunk.kind == Kind::Segment && chunk.segment > 0 => group.push(chunk),
            _ => levels.push(vec![chunk]),
        }
    }
    let mut levels = levels.into_iter();
    let mut out: Group<B> = levels.next().into_iter().flatten().chain(appearance).collect();
    let mut previews = previews.into_iter();
    let mut rows = Vec::with_capacity(images.len());
    for image in images {
        let mut previews = previews.next().into_iter().flatten();
        out.extend(previews.next());
        rows.push(previews.chain(image).map(|chunk| vec![chunk]).collect());
    }
    let pieces = merge(rows);
    let rest = match schedule {
        Schedule::MeshFirst => levels.chain(pieces).collect(),
        Schedule::TextureFirst => pieces.into_iter().chain(levels).collect(),
        Schedule::Linear => merge(vec![levels.collect(), pieces]),
    };
    out.extend(rest.into_iter().flatten().chain(reconstructions));
    let mut level = 0;
    for chunk in &mut out {
        match chunk.kind {
            Kind::Appearance | Kind::Image | Kind::Reconstruction | Kind::Preview => {
                (chunk.first_level, chunk.last_level) = (level, level)
            }
            _ => level = chunk.last_level,
        }
    }
    out
}

/// Several rows as one: next comes what takes its row least far through its bytes; where that is the same, the earlier row.
fn merge<B: AsRef<[u8]>>(rows: Vec<Vec<Group<B>>>) -> Vec<Group<B>> {
    let bytes = |group: &Group<B>| group.iter().map(|c| c.payload.as_ref().len() as u128).sum::<u128>();
    let total: Vec<u128> = rows.iter().map(|row| row.iter().map(bytes).sum::<u128>().max(1)).collect();
    let mut keyed: Vec<(u128, usize, Group<B>)> = Vec::new();
    for (k, row) in rows.into_iter().enumerate() {
        let mut done = 0;
        for group in row {
            done += bytes(&group);
            // Fractions of 2^64.
            keyed.push(((done << 64) / total[k], k, group));
        }
    }
    // Stable: groups of a row stay in order.
    keyed.sort_by_key(|&(fraction, row, _)| (fraction, row));
    keyed.into_iter().map(|(_, _, group)| group).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::container::Preview;

    fn shape(schedule: Schedule) -> String {
        let mesh = vec![
            Chunk::base(2, vec![0; 10]),
            Chunk::levels(3..=4, vec![0; 20]),
            Chunk::segment(5, 0, 2, vec![0; 20]),
            Chunk::segment(5, 1, 2, vec![0; 20]),
            Chunk::levels(6..=6, vec![0; 60]),
            Chunk::extra(6, vec![0; 1]),
        ];
        let image = |i, sizes: &[usize]| {
            let n = sizes.len() as u32;
            sizes.iter().zip(0..).map(|(&size, k)| Chunk::image(0, i, k, n, vec![0; size])).collect::<Vec<_>>()
        };
        let images = vec![image(0, &[100, 300, 600]), image(1, &[50, 50]), image(2, &[0])];
        let preview = |image: u32, sizes: &[usize]| {
            let chunk = |(&size, number)| Chunk::preview(0, &Preview { image, number, bytes: &vec![0; size] });
            sizes.iter().zip(0..).map(chunk).collect::<Vec<_>>()
        };
        let pictures = Pictures {
            appearance: Some(Chunk::appearance(0, vec![0; 5])),
            previews: vec![preview(0, &[4, 20]), preview(1, &[1]), preview(2, &[])],
            images,
            reconstructions: vec![Chunk::reconstruction(0, 0, vec![0])],
        };
        let chunks = order(mesh, pictures, schedule);
        let name = |c: &Chunk| match c.kind {
            Kind::Image => format!("{}{}@{}", (b'a' + c.image as u8) as char, c.segment, c.first_level),
            Kind::Appearance => "m".into(),
            Kind::Reconstruction => format!("r@{}", c.first_level),
            Kind::Preview => format!("p{}{}@{}", (b'a' + c.payload[0]) as char, c.payload[1], c.first_level),
            _ => format!("{}", c.last_level),
        };
        chunks.iter().map(name).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn chunks_stand_in_the_order_asked_for() {
        assert_eq!(shape(Schedule::MeshFirst), "2 m pa0@2 pb0@2 4 5 5 6 6 c0@6 pa1@6 a0@6 a1@6 b0@6 a2@6 b1@6 r@6");
        assert_eq!(shape(Schedule::TextureFirst), "2 m pa0@2 pb0@2 c0@2 pa1@2 a0@2 a1@2 b0@2 a2@2 b1@2 4 5 5 6 6 r@6");
        assert_eq!(shape(Schedule::Linear), "2 m pa0@2 pb0@2 c0@2 pa1@2 a0@2 4 a1@4 b0@4 5 5 a2@5 6 6 b1@6 r@6");
        for schedule in Schedule::ALL {
            assert_eq!(schedule.to_string().parse(), Ok(schedule));
        }
        assert_eq!(
            "last".parse::<Schedule>().unwrap_err(),
            "\"last\" is no order of chunks; use mesh-first, texture-first or linear"
        );
    }
}
