//! Cells of the grid as pictures: levels are decoded in their order, images as far as their pieces are there.

use super::plan::Cell;
use super::{Layout, Options, Previews, ScheduleError};
use crate::format::container::{ContainerError, FileIndex, Kind, Preview};
use crate::format::decoder::{DecodeError, DecodeOptions, Decoder, Step};
use crate::image::jpeg::END;
use crate::mesh::Mesh;
use crate::parallel;
use crate::quality::picture::{Drawable, Scene, Shading, Textures};
use crate::quality::{Snapshots, ViewOptions};
use std::collections::BTreeMap;

/// What is there of an image, less before more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum State {
    #[default]
    Nothing,
    /// The preview with this number.
    Preview(u32),
    /// So many of its pieces.
    Pieces(u32),
}

/// A file, its pictures, and what was decoded of it.
pub(super) struct Stage<'a> {
    file: &'a [u8],
    front: &'a FileIndex,
    memory_limit: u64,
    shown: Vec<bool>,
    /// Pictures of the whole file, if it has images that are drawn.
    whole: Option<Snapshots>,
    images: Images<'a>,
    drawn: usize,
}

impl<'a> Stage<'a> {
    /// Decode the whole file, and draw it if its images are to be seen.
    pub(super) fn new(
        file: &'a [u8],
        front: &'a FileIndex,
        previews: &'a Previews,
        options: &Options,
    ) -> Result<Self, ScheduleError> {
        let mut stage = Stage {
            file,
            front,
            memory_limit: options.memory_limit,
            shown: Vec::new(),
            whole: None,
            images: Images {
                file,
                front,
                previews,
                kept: BTreeMap::new(),
                bytes: 0,
                most: options.image_cache,
                turn: 0,
            },
            drawn: 0,
        };
        if front.header().attributes.images == 0 {
            return Ok(stage);
        }
        let mesh = stage.decoder()?.level(front.full_level())?;
        stage.shown = Textures::shown(&mesh.appearance);
        // What was left out by `--drop images` has a place and no bytes.
        let there =
            |i: usize| front.chunks().iter().any(|c| c.kind == Kind::Image && c.image as usize == i && c.length > 0);
        stage.shown.iter_mut().enumerate().for_each(|(i, shown)| *shown &= there(i));
        if stage.shown.contains(&true) {
            let (views, size) = options.effort.views();
            let look = ViewOptions { views, size, shading: Shading::Smooth };
            let states = stage.states(&(0..front.chunks().len()).collect::<Vec<_>>());
            let textures = stage.images.textures(&stage.shown, &states);
            let scene = Scene::with_textures(&mesh, Shading::Smooth, &textures);
            stage.whole = Some(Snapshots::of(&scene, &mesh, &look)?);
        }
        Ok(stage)
    }

    /// Which images pictures show.
    pub(super) fn shown(&self) -> &[bool] {
        &self.shown
    }

    /// How many cells were drawn.
    pub(super) fn drawn(&self) -> usize {
        self.drawn
    }

    /// The first row of the mesh that, with all images, is as like the whole file as `seen`, and the worth of the rows up to it.
    pub(super) fn first_resolved(
        &mut self,
        layout: &Layout,
        last: Cell,
        seen: f64,
        report: &mut dyn FnMut(usize),
    ) -> Result<(usize, Vec<(Cell, f64)>), ScheduleError> {
        let mut out = Vec::new();
        let mut decoder = self.decoder()?;
        for row in 0..last.0 {
            let mesh = decoder.level(layout.levels[row])?;
            let quality = self.row(layout, &mesh, &[(row, last.1)], report)?[0];
            out.push(quality);
            if quality.1 >= seen {
                return Ok((row, out));
            }
        }
        out.push((last, 1.0));
        Ok((last.0, out))
    }

    /// What cells, sorted, are worth.
    pub(super) fn measure(
        &mut self,
        layout: &Layout,
        cells: &[Cell],
        report: &mut dyn FnMut(usize),
    ) -> Result<Vec<(Cell, f64)>, ScheduleError> {
        let mut out = Vec::with_capacity(cells.len());
        let mut decoder = self.decoder()?;
        for row in cells.chunk_by(|a, b| a.0 == b.0) {
            let mesh = decoder.level(layout.levels[row[0].0])?;
            out.extend(self.row(layout, &mesh, row, report)?);
        }
        Ok(out)
    }

    /// What the cells of one row are worth.
    fn row(
        &mut self,
        layout: &Layout,
        mesh: &Mesh,
        cells: &[Cell],
        report: &mut dyn FnMut(usize),
    ) -> Result<Vec<(Cell, f64)>, ScheduleError> {
        let Some(whole) = &self.whole else { return Ok(cells.iter().map(|&c| (c, 1.0)).collect()) };
        let mut scene: Option<Scene> = None;
        let mut out = Vec::with_capacity(cells.len());
        for &cell in cells {
            let states = self.states(&layout.pieces[..cell.1].concat());
            let textures = self.images.textures(&self.shown, &states);
            match &mut scene {
                Some(scene) => scene.repaint(mesh, &textures),
                None => scene = Some(Scene::with_textures(mesh, Shading::Smooth, &textures)),
            }
            if let Some(scene) = &scene {
                out.push((cell, whole.compare_scene(scene)?.ms_ssim));
            }
            self.drawn += 1;
            report(self.drawn);
        }
        Ok(out)
    }

    /// What is there of each image with these chunks.
    fn states(&self, chunks: &[usize]) -> Vec<State> {
        let mut states = vec![State::Nothing; self.shown.len()];
        for &i in chunks {
            let c = &self.front.chunks()[i];
            let (image, state) = match (c.kind, self.images.previews.get(&i)) {
                (Kind::Image, _) => (c.image as usize, State::Pieces(c.segment + 1)),
                (_, Some(&(image, number))) => (image, State::Preview(number)),
                _ => continue,
            };
            if let Some(at) = states.get_mut(image) {
                *at = state.max(*at);
            }
        }
        states
    }

    /// A decoder that has the materials already: their chunk may stand behind all levels that are coded with level 0.
    fn decoder(&self) -> Result<Levels, ScheduleError> {
        let mut decoder = Decoder::new(DecodeOptions { memory_limit: self.memory_limit });
        decoder.push(self.file);
        decoder.index()?;
        for (index, &info) in self.front.chunks().iter().enumerate() {
            if info.kind == Kind::Appearance
                && let Some(payload) = self.front.payload(self.file, index)?
            {
                decoder.offer(info, payload.to_vec())?;
            }
        }
        Ok(Levels { decoder, at: None })
    }
}

/// Levels of a file, one after another.
struct Levels {
    decoder: Decoder,
    at: Option<u32>,
}

impl Levels {
    /// A level no coarser than the last one that was asked for.
    fn level(&mut self, level: u32) -> Result<Mesh, ScheduleError> {
        while self.at.is_none_or(|at| at < level) {
            match self.decoder.next_level()? {
                Step::Level(at) => self.at = Some(at),
                Step::Full => break,
                Step::NeedBytes => {
                    let cut = ContainerError::Truncated { have: 0, need: 0, exact: false, level: self.at };
                    return Err(DecodeError::Container(cut).into());
                }
            }
        }
        let mut mesh = self.decoder.to_mesh();
        // Images are drawn from their pieces.
        mesh.appearance.images.iter_mut().for_each(|image| image.bytes = Vec::new());
        Ok(mesh)
    }
}

/// Images decoded from their previews and their first pieces.
struct Images<'a> {
    file: &'a [u8],
    front: &'a FileIndex,
    previews: &'a Previews,
    /// By image and state: the image, or nothing where it does not decode; and when it was used last.
    kept: BTreeMap<(usize, State), (Option<Drawable>, u64)>,
    bytes: u64,
    /// Bytes that are kept for later turns.
    most: u64,
    turn: u64,
}

impl Images<'_> {
    /// The images that are shown, each from what is there of it.
    fn textures(&mut self, shown: &[bool], states: &[State]) -> Textures {
        self.turn += 1;
        let wanted = |i: &usize| shown[*i] && states[*i] > State::Nothing;
        let missing: Vec<(usize, State)> = (0..shown.len())
            .filter(wanted)
            .map(|i| (i, states[i]))
            .filter(|key| !self.kept.contains_key(key))
            .collect();
        let this = &*self;
        for (key, image) in parallel::map(missing, |key| (key, Drawable::new(&this.bytes_of(key)).ok())) {
            self.bytes += image.as_ref().map_or(0, Drawable::memory) as u64;
            self.kept.insert(key, (image, self.turn));
        }
        let mut out = vec![None; shown.len()];
        for i in (0..shown.len()).filter(wanted) {
            if let Some((image, used)) = self.kept.get_mut(&(i, states[i])) {
                *used = self.turn;
                out[i] = image.clone();
            }
        }
        while self.bytes > self.most {
            let oldest = self.kept.iter().map(|(&key, &(_, used))| (used, key)).min();
            match oldest {
                Some((used, key)) if used < self.turn => {
                    let gone = self.kept.remove(&key).and_then(|(image, _)| image);
                    self.bytes -= gone.map_or(0, |image| image.memory()) as u64;
                }
                _ => break,
            }
        }
        Textures::of(out)
    }

    /// The file of an image as a decoder has it.
    fn bytes_of(&self, (image, state): (usize, State)) -> Vec<u8> {
        let mut bytes = Vec::new();
        let count = match state {
            State::Nothing => 0,
            State::Preview(number) => {
                let index = self.previews.iter().find(|(_, of)| **of == (image, number)).map(|(&index, _)| index);
                let payload = index.and_then(|index| self.front.payload(self.file, index).ok().flatten());
                return payload.and_then(Preview::of).map_or(bytes, |preview| preview.bytes.to_vec());
            }
            State::Pieces(count) => count,
        };
        let chunks = self.front.chunks().iter().enumerate();
        let mut pieces: Vec<_> = chunks.filter(|(_, c)| c.kind == Kind::Image && c.image as usize == image).collect();
        pieces.sort_by_key(|(_, c)| c.segment);
        let all = pieces.first().map_or(0, |(_, c)| c.segments);
        for (index, _) in pieces.into_iter().take(count as usize) {
            if let Ok(Some(payload)) = self.front.payload(self.file, index) {
                bytes.extend_from_slice(payload);
            }
        }
        if count < all {
            bytes.extend_from_slice(&END);
        }
        bytes
    }
}
