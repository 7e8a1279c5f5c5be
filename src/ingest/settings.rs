//! How one file is to be encoded, and the one spelling of it that goes into checksums.

use crate::encode::EncodeOptions;
use crate::encode::pipeline::Pipeline;
use crate::encode::quality_order::{self, Effort, Order};
use crate::image::preview::Previews;
use crate::image::recompress::Textures;
use crate::io::read::{DropSet, Invalid};
use sha2::{Digest, Sha256};
use std::path::PathBuf;

/// Bytes of decoded images that the order by quality keeps.
pub(super) const IMAGE_CACHE: u64 = 64 << 20;

/// How one file is to be encoded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    /// The encoder's options.
    pub encode: EncodeOptions,
    /// Join vertex records at equal positions; `None`: as the format needs it.
    pub weld: Option<bool>,
    /// What to leave out without a warning.
    pub drop: DropSet,
    /// Whether a file without any vertex is a mesh.
    pub allow_empty: bool,
    /// What becomes of vertices with a coordinate that is NaN or infinite.
    pub invalid: Invalid,
    /// The folder in which files have to lie that a mesh refers to; `None`: that of the mesh.
    pub asset_root: Option<PathBuf>,
    /// Leave out vertices that no element uses.
    pub drop_isolated: bool,
    /// What becomes of images that are no JPEG.
    pub textures: Textures,
    /// Whether images get previews.
    pub previews: Previews,
    /// Put chunks in the order by quality; otherwise they come as [`EncodeOptions::schedule`] says.
    pub by_quality: bool,
    /// How closely that order looks.
    pub effort: Effort,
}

impl Settings {
    /// The way from a mesh to its file.
    pub(super) fn pipeline(&self) -> Pipeline {
        let order = if self.by_quality { Order::Quality } else { Order::Fixed(self.encode.schedule) };
        // The file is our own, and what ordering it takes was foreseen.
        let looks = quality_order::Options { effort: self.effort, image_cache: IMAGE_CACHE, memory_limit: u64::MAX };
        Pipeline { encode: self.encode.clone(), textures: self.textures, previews: self.previews, order, looks }
    }
}

/// The names of what can be left out, on the command line and in manifests.
pub const DROP_NAMES: [&str; 8] = ["all", "normals", "colors", "uvs", "images", "materials", "tangents", "scalars"];

/// What is left out where these names are given; an unknown one comes back.
///
/// # Errors
/// The first name that is none of [`DROP_NAMES`].
pub fn drop_set<'a>(names: impl IntoIterator<Item = &'a str>) -> Result<DropSet, &'a str> {
    let mut set = DropSet::NONE;
    for name in names {
        match name.trim() {
            "all" => set = DropSet::ALL,
            "normals" => set.normals = true,
            "colors" => set.colors = true,
            "uvs" => set.uvs = true,
            "images" => set.images = true,
            "materials" => set.materials = true,
            "tangents" => set.tangents = true,
            "scalars" => set.scalars = true,
            _ => return Err(name),
        }
    }
    Ok(set)
}

impl Settings {
    /// Follow this order.
    pub fn set_order(&mut self, order: Order) {
        self.by_quality = order == Order::Quality;
        if let Order::Fixed(schedule) = order {
            self.encode.schedule = schedule;
        }
    }

    /// SHA-256 of all that shapes the output besides the source: these settings and the version of the encoder.
    ///
    /// The derived `Debug` form is the spelling, so that an option that joins [`EncodeOptions`] joins the checksum;
    /// it prints numbers in full. A new version of the program has outputs of its own.
    pub fn checksum(&self) -> [u8; 32] {
        let mut text = format!(
            "lodestream {} format {}\n{:?}\nweld {:?} drop {:?}\ntextures {:?} previews {:?}\nby quality {:?}\n",
            env!("CARGO_PKG_VERSION"),
            crate::format::container::VERSION,
            self.encode,
            self.weld,
            self.drop,
            self.textures,
            self.previews,
            self.by_quality.then_some(self.effort)
        );
        // Said only where it is asked for, so that outputs made before it could be asked for stay what they are.
        if (self.allow_empty, self.invalid, &self.asset_root) != (false, Invalid::Error, &None) {
            text += &format!("empty {} invalid {:?} assets {:?}\n", self.allow_empty, self.invalid, self.asset_root);
        }
        if self.drop_isolated {
            text += "isolated drop\n";
        }
        Sha256::digest(text.as_bytes()).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::lattice::Quantization;
    use crate::mesh::quantizer::Precision;

    #[test]
    fn every_setting_changes_the_checksum() {
        let plain = Settings::default();
        let mut others = vec![plain.clone(); 20];
        others[0].encode.quantization = Quantization::Bits(13);
        others[1].encode.quantization = Quantization::Step { step: 0.001, origin: None };
        others[2].encode.lock_borders = true;
        others[3].weld = Some(false);
        others[4].drop.uvs = true;
        others[5].encode.uv = Precision::Bits(13);
        others[6].encode.uv = Precision::Step(0.001);
        others[7].encode.normal_bits = 11;
        others[8].encode.color_bits = 9;
        others[9].encode.scalar_bits = 15;
        others[10].encode.images = crate::image::jpeg::Exactness::Bytes;
        others[11].encode.schedule = crate::encode::Schedule::Linear;
        others[12].textures = Textures::Jpeg(90);
        others[13].set_order(Order::Quality);
        others[14].set_order(Order::Quality);
        others[14].effort = Effort::High;
        others[15].previews = Previews::None;
        others[16].allow_empty = true;
        others[17].invalid = Invalid::Drop;
        others[18].asset_root = Some("/scans".into());
        others[19].drop_isolated = true;
        let mut sums: Vec<[u8; 32]> = others.iter().map(Settings::checksum).collect();
        sums.push(plain.checksum());
        sums.sort_unstable();
        sums.dedup();
        assert_eq!(sums.len(), 21);
        // How closely is looked says nothing where nobody looks.
        assert_eq!(Settings { effort: Effort::Low, ..plain.clone() }.checksum(), plain.checksum());
        assert_eq!(drop_set(["uvs", " normals "]), Ok(DropSet { uvs: true, normals: true, ..DropSet::NONE }));
        assert_eq!(drop_set(["uvs", "uvw"]), Err("uvw"));
        assert!(DROP_NAMES.iter().all(|name| drop_set([*name]).is_ok()));
    }
}
