//! Pictures of meshes without a graphics card: a z-buffer over orthographic projection, Lambert shading, PNG.
//!
//! For looking at results (`lodestream demo`) and for tests that compare appearances. Rows are cut into bands that
//! the cores draw side by side; the picture does not depend on how many there are.

mod font;
mod raster;

pub use raster::{Shading, View, render};

use std::io;

/// An 8-bit RGB picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green, blue of each pixel, row by row from the top.
    pub rgb: Vec<u8>,
}

impl Picture {
    /// A picture of one colour.
    pub fn new(width: u32, height: u32, colour: [u8; 3]) -> Self {
        Picture { width, height, rgb: colour.repeat(width as usize * height as usize) }
    }

    /// The pixel in column `x` of row `y`.
    ///
    /// # Panics
    /// Outside the picture.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let at = 3 * (y as usize * self.width as usize + x as usize);
        [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
    }

    fn set(&mut self, x: u32, y: u32, colour: [u8; 3]) {
        if x < self.width && y < self.height {
            let at = 3 * (y as usize * self.width as usize + x as usize);
            self.rgb[at..at + 3].copy_from_slice(&colour);
        }
    }

    /// Copy `other` so that its upper left corner is at `(x, y)`; what lies outside is cut off.
    pub fn paste(&mut self, other: &Picture, x: u32, y: u32) {
        for row in 0..other.height {
            for column in 0..other.width {
                self.set(x + column, y + row, other.pixel(column, row));
            }
        }
    }

    /// Write `text` with its upper left corner at `(x, y)`, letters of 5 by 7 pixels times `scale`.
    pub fn text(&mut self, x: u32, y: u32, scale: u32, colour: [u8; 3], text: &str) {
        for (i, letter) in text.chars().enumerate() {
            let left = x + i as u32 * 6 * scale;
            for (column, bits) in font::glyph(letter).into_iter().enumerate() {
                for row in (0..8).filter(|row| bits >> row & 1 == 1) {
                    for dot in 0..scale * scale {
                        let (dx, dy) = (dot % scale, dot / scale);
                        self.set(left + column as u32 * scale + dx, y + row * scale + dy, colour);
                    }
                }
            }
        }
    }

    /// Write the picture as PNG.
    ///
    /// # Errors
    /// What `out` reports.
    pub fn write_png(&self, out: impl io::Write) -> io::Result<()> {
        let mut encoder = png::Encoder::new(out, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.rgb)?;
        Ok(writer.finish()?)
    }
}

/// One picture of a [`contact_sheet`] with the lines below it.
#[derive(Clone, Debug)]
pub struct Tile {
    /// The picture.
    pub picture: Picture,
    /// Lines of text below it.
    pub caption: Vec<String>,
}

const PAPER: [u8; 3] = [24, 26, 31];
const INK: [u8; 3] = [222, 226, 233];

/// Pictures side by side, `columns` in a row, under a title.
pub fn contact_sheet(title: &str, tiles: &[Tile], columns: u32) -> Picture {
    const GAP: u32 = 12;
    const LINE: u32 = 20;
    let columns = columns.clamp(1, tiles.len().max(1) as u32);
    let rows = (tiles.len() as u32).div_ceil(columns);
    let width = tiles.iter().map(|t| t.picture.width).max().unwrap_or(0);
    let lines = tiles.iter().map(|t| t.caption.len() as u32).max().unwrap_or(0);
    let height = tiles.iter().map(|t| t.picture.height).max().unwrap_or(0) + lines * LINE + GAP;
    let head = 2 * LINE;
    let mut sheet = Picture::new(GAP + columns * (width + GAP), head + rows * (height + GAP), PAPER);
    sheet.text(GAP, GAP, 2, INK, title);
    for (i, tile) in tiles.iter().enumerate() {
        let x = GAP + (i as u32 % columns) * (width + GAP);
        let y = head + (i as u32 / columns) * (height + GAP);
        sheet.paste(&tile.picture, x, y);
        for (line, text) in tile.caption.iter().enumerate() {
            sheet.text(x + 2, y + tile.picture.height + 6 + line as u32 * LINE, 2, INK, text);
        }
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate;
    use crate::mesh::Mesh;

    #[test]
    fn a_sphere_is_a_bright_disc() {
        let mesh = generate::sphere(8, 0.0, 0);
        let view = View::front(&mesh);
        let picture = render(&mesh, &view, Shading::Smooth, 64, 64);
        let background = picture.pixel(0, 0);
        assert_ne!(picture.pixel(32, 32), background);
        let covered =
            (0..64 * 64).filter(|i| picture.pixel(i % 64, i / 64) != background).count() as f64 / (64.0 * 64.0);
        // A disc of 9/10 of the width covers 0.64 of the square.
        assert!((0.5..0.8).contains(&covered), "{covered}");
        for shading in [Shading::Flat, Shading::Wire] {
            assert_ne!(render(&mesh, &view, shading, 64, 64), picture);
        }
    }

    #[test]
    fn edges_points_and_nothing_are_drawn_too() {
        for mesh in [generate::crumbs(40, 1), generate::point_cloud(50, 1), generate::fan_book(7, 2, 1)] {
            let picture = render(&mesh, &View::front(&mesh), Shading::Flat, 50, 40);
            let background = picture.pixel(0, 0);
            assert!((0..50 * 40).any(|i| picture.pixel(i % 50, i / 50) != background));
        }
        let empty = Mesh::default();
        render(&empty, &View::front(&empty), Shading::Flat, 8, 8);
    }

    #[test]
    fn sheets_are_readable_png_files() {
        let tile = |n: u32| Tile { picture: Picture::new(n, n, [n as u8; 3]), caption: vec![format!("level {n}")] };
        let sheet = contact_sheet("three levels", &[tile(30), tile(60), tile(45)], 2);
        let mut bytes = Vec::new();
        sheet.write_png(&mut bytes).unwrap();
        let mut reader = png::Decoder::new(io::Cursor::new(&bytes)).read_info().unwrap();
        let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut rgb).unwrap();
        assert_eq!((info.width, info.height), (sheet.width, sheet.height));
        assert_eq!(rgb, sheet.rgb);
    }
}
