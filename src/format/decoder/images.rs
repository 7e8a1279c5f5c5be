//! Materials and images as they arrive: a preview stands in for an image until its first piece is there, each piece makes it a better one, and
//! a reconstruction its very bytes.

use super::{DecodeError, corrupt};
use crate::format::appearance::{AppearanceError, code_appearance};
use crate::format::coder::{InvalidStream, range};
use crate::format::container::{ChunkInfo, ContainerError, FileIndex, Kind, Preview};
use crate::image::jpeg::{END, Unsupported, restore};
use crate::mesh::Appearance;

/// A preview that is shown.
#[derive(Debug)]
pub(super) struct Shown {
    number: u32,
    /// The media type of the image itself.
    mime: String,
}

/// Materials and images, as far as they have arrived.
#[derive(Debug, Default)]
pub(super) struct Images {
    pub(super) appearance: Option<Appearance>,
    /// Bytes of memory that materials take beyond what their chunk announced.
    pub(super) held: u64,
    /// Of each image how many pieces are here, and how many there are.
    pieces: Vec<[u32; 2]>,
    /// Of each image the preview that it shows.
    previews: Vec<Option<Shown>>,
    /// Bytes of images, or of their previews, that are here.
    pub(super) bytes: u64,
}

/// What has not arrived of the images of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MissingImages {
    /// How many images there are.
    pub all: usize,
    /// Those of which nothing has arrived.
    pub none: usize,
    /// Those of which a preview or some pieces have arrived, and not all.
    pub part: usize,
}

/// What a file may take.
#[derive(Clone, Copy)]
pub(super) struct Allowance<'a> {
    pub(super) index: &'a FileIndex,
    /// Bytes of memory.
    pub(super) limit: u64,
}

impl Images {
    /// Check that a level fits, beside the materials and images that are here already.
    pub(super) fn afford(&self, to: Allowance, level: u32) -> Result<(), DecodeError> {
        // Images that were fetched apart are here before their turn.
        let early = self.bytes.saturating_sub(to.index.image_bytes(level));
        let needed = to.index.memory(level).saturating_add(self.held).saturating_add(early);
        if needed > to.limit { Err(ContainerError::MemoryLimit { needed, limit: to.limit }.into()) } else { Ok(()) }
    }

    /// What has not arrived, of `all` images.
    pub(super) fn missing(&self, all: usize) -> MissingImages {
        let Images { pieces, previews, .. } = self;
        let begun = pieces.iter().zip(previews).filter(|(p, shown)| p[0] > 0 || shown.is_some()).count();
        let whole = pieces.iter().filter(|p| p[0] > 0 && p[0] == p[1]).count();
        MissingImages { all, none: all.saturating_sub(begun), part: begun - whole }
    }

    /// Materials or an image.
    pub(super) fn take(
        &mut self,
        to: Allowance,
        level: u32,
        info: ChunkInfo,
        payload: Vec<u8>,
    ) -> Result<(), DecodeError> {
        match (info.kind, &mut self.appearance) {
            (Kind::Appearance, None) => {
                let mut coder = range::Decoder::new(payload);
                let limit = to.limit;
                let used = to.index.memory(level);
                let room = limit.saturating_sub(used).saturating_add(info.memory);
                let (appearance, held) =
                    code_appearance(&mut coder, &Appearance::default(), room).map_err(|error| match error {
                        AppearanceError::InvalidStream(InvalidStream(what)) => corrupt(level, what),
                        AppearanceError::Memory { needed } => ContainerError::MemoryLimit {
                            needed: used.saturating_sub(info.memory).saturating_add(needed),
                            limit,
                        }
                        .into(),
                    })?;
                if coder.overrun() {
                    return Err(corrupt(level, "materials that end too early"));
                }
                let announced = &to.index.header().attributes;
                let found = (appearance.materials.len(), appearance.images.len());
                if found != (announced.materials as usize, announced.images as usize) {
                    return Err(corrupt(level, "other materials or images than the header announces"));
                }
                self.pieces = vec![[0; 2]; appearance.images.len()];
                self.previews = appearance.images.iter().map(|_| None).collect();
                self.appearance = Some(appearance);
                self.held = held.saturating_sub(info.memory);
            }
            (Kind::Image, Some(_)) => self.take_piece(to, level, info, payload)?,
            (Kind::Reconstruction, Some(_)) => self.take_reconstruction(to, level, info, &payload)?,
            (Kind::Preview, Some(_)) => self.take_preview(to, level, payload)?,
            // Offered before its chunk came.
            (Kind::Appearance, Some(_)) => {}
            (Kind::Image | Kind::Reconstruction, None) => return Err(corrupt(level, "images before materials")),
            _ => {}
        }
        Ok(())
    }

    /// The next piece of an image; without the last one, an end marker makes a file of what is there.
    fn take_piece(
        &mut self,
        to: Allowance,
        level: u32,
        info: ChunkInfo,
        mut payload: Vec<u8>,
    ) -> Result<(), DecodeError> {
        let Some([next, all]) = self.pieces.get_mut(info.image as usize) else { return Ok(()) };
        if info.segment < *next {
            // Offered before its chunk came.
            return Ok(());
        }
        if info.segment > *next {
            return Err(corrupt(level, "a piece of an image before the pieces that it follows"));
        }
        let (open, last) = (*next > 0, info.segment + 1 == info.segments);
        (*next, *all) = (info.segment + 1, info.segments);
        if let Some(shown) = self.previews.get_mut(info.image as usize).and_then(Option::take)
            && let Some(image) = self.appearance.as_mut().and_then(|a| a.images.get_mut(info.image as usize))
        {
            self.bytes = self.bytes.saturating_sub(image.bytes.len() as u64);
            image.bytes = Vec::new();
            image.mime = shown.mime;
        }
        self.bytes = self.bytes.saturating_add(payload.len() as u64);
        self.afford(to, level)?;
        if !last {
            payload.extend_from_slice(&END);
        }
        let Some(image) = self.appearance.as_mut().and_then(|a| a.images.get_mut(info.image as usize)) else {
            return Ok(());
        };
        if open {
            image.bytes.truncate(image.bytes.len().saturating_sub(END.len()));
            image.bytes.extend_from_slice(&payload);
        } else {
            image.bytes = payload;
        }
        Ok(())
    }

    /// A preview, for an image of which there is nothing finer. One that makes no sense, or of an image that is not there, is passed over:
    /// decoders that do not know the kind do the same.
    fn take_preview(&mut self, to: Allowance, level: u32, mut payload: Vec<u8>) -> Result<(), DecodeError> {
        let Some(preview) = Preview::of(&payload) else { return Ok(()) };
        let Preview { image, number, bytes } = preview;
        let (Some(mime), head) = (preview.media_type(), payload.len() - bytes.len()) else { return Ok(()) };
        let at = image as usize;
        let (Some([0, _]), Some(shown), Some(image)) = (
            self.pieces.get(at),
            self.previews.get_mut(at),
            self.appearance.as_mut().and_then(|a| a.images.get_mut(at)),
        ) else {
            return Ok(());
        };
        let told = match shown.take() {
            Some(finer) if finer.number >= number => {
                *shown = Some(finer);
                return Ok(());
            }
            Some(coarser) => coarser.mime,
            None => std::mem::take(&mut image.mime),
        };
        payload.drain(..head);
        let (new, old) = (payload.len() as u64, image.bytes.len() as u64);
        (image.mime, image.bytes) = (mime.to_string(), payload);
        *shown = Some(Shown { number, mime: told });
        self.bytes = self.bytes.saturating_sub(old).saturating_add(new);
        self.afford(to, level)
    }

    /// The reconstruction of an image that is whole: its very bytes.
    fn take_reconstruction(
        &mut self,
        to: Allowance,
        level: u32,
        info: ChunkInfo,
        reconstruction: &[u8],
    ) -> Result<(), DecodeError> {
        const DONE: u32 = u32::MAX;
        match self.pieces.get(info.image as usize) {
            Some([DONE, DONE]) => return Ok(()),
            Some([have, all]) if have == all && *all > 0 => {}
            _ => return Err(corrupt(level, "the reconstruction of an image before the image")),
        }
        let limit = to.limit;
        let used = to.index.memory(level).saturating_add(self.held);
        let room = limit.saturating_sub(used.saturating_sub(info.memory));
        let image = self.appearance.as_mut().and_then(|a| a.images.get_mut(info.image as usize));
        if let Some(image) = image {
            image.bytes =
                restore(&image.bytes, reconstruction, room).map_err(|Unsupported(what)| corrupt(level, what))?;
        }
        if let Some(pieces) = self.pieces.get_mut(info.image as usize) {
            *pieces = [DONE; 2];
        }
        Ok(())
    }
}
