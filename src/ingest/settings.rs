//! How one file is to be encoded, and the one spelling of it that goes into checksums.

use crate::encode::EncodeOptions;
use sha2::{Digest, Sha256};

/// How one file is to be encoded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    /// The encoder's options.
    pub encode: EncodeOptions,
    /// Join vertex records at equal positions; `None`: as the format needs it.
    pub weld: Option<bool>,
    /// Attributes to leave out without a warning, by the names of `encode --drop`.
    pub drop: Vec<Drop>,
}

/// Attributes that can be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Drop {
    /// All of them.
    All,
    /// Normals.
    Normals,
    /// Colours.
    Colors,
    /// Texture coordinates.
    Uvs,
    /// Images.
    Images,
    /// Materials.
    Materials,
    /// Tangents.
    Tangents,
}

impl Drop {
    /// All, with their names on the command line and in manifests.
    pub const NAMES: [(&'static str, Drop); 7] = [
        ("all", Drop::All),
        ("normals", Drop::Normals),
        ("colors", Drop::Colors),
        ("uvs", Drop::Uvs),
        ("images", Drop::Images),
        ("materials", Drop::Materials),
        ("tangents", Drop::Tangents),
    ];

    /// The one of that name.
    pub fn from_name(name: &str) -> Option<Drop> {
        Drop::NAMES.iter().find(|(n, _)| *n == name.trim()).map(|(_, d)| *d)
    }

    /// Whether a warning tells of what was asked to be left out.
    pub fn covers(list: &[Drop], warning: &crate::read::Warning) -> bool {
        use crate::read::{Layer, Warning};
        let layer = match warning {
            Warning::NotCarried { layer, .. } => layer,
            // Further properties are attributes too.
            Warning::SkippedProperties { .. } => return list.contains(&Drop::All),
            _ => return false,
        };
        list.iter().any(|d| match d {
            Drop::All => true,
            Drop::Normals => *layer == Layer::Normals,
            Drop::Colors => *layer == Layer::Colours,
            Drop::Uvs => *layer == Layer::TextureCoordinates,
            // References to images are part of the materials.
            Drop::Images | Drop::Materials => *layer == Layer::Materials,
            Drop::Tangents => *layer == Layer::Tangents,
        })
    }
}

impl Settings {
    /// SHA-256 of all that shapes the output besides the source: these settings and the version of the encoder.
    ///
    /// The derived `Debug` form is the spelling, so that an option that joins [`EncodeOptions`] joins the checksum;
    /// it prints numbers in full. A new version of the program has outputs of its own.
    pub fn checksum(&self) -> [u8; 32] {
        let mut drop = self.drop.clone();
        drop.sort_unstable();
        drop.dedup();
        let text = format!(
            "lodestream {} format {}\n{:?}\nweld {:?} drop {:?}\n",
            env!("CARGO_PKG_VERSION"),
            crate::container::VERSION,
            self.encode,
            self.weld,
            drop
        );
        Sha256::digest(text.as_bytes()).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lattice::Quantization;

    #[test]
    fn every_setting_changes_the_checksum() {
        let plain = Settings::default();
        let mut others = vec![plain.clone(); 5];
        others[0].encode.quantization = Quantization::Bits(13);
        others[1].encode.quantization = Quantization::Step { step: 0.001, origin: None };
        others[2].encode.lock_borders = true;
        others[3].weld = Some(false);
        others[4].drop = vec![Drop::Uvs];
        let mut sums: Vec<[u8; 32]> = others.iter().map(Settings::checksum).collect();
        sums.push(plain.checksum());
        sums.sort_unstable();
        sums.dedup();
        assert_eq!(sums.len(), 6);
        let twice = Settings { drop: vec![Drop::Uvs, Drop::Uvs], ..plain.clone() };
        let once = Settings { drop: vec![Drop::Uvs], ..plain };
        assert_eq!(twice.checksum(), once.checksum());
    }
}
