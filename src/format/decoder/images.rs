//! Materials and images as they arrive: a preview stands in for an image until its first piece is there, each piece makes it a better one, and
//! a reconstruction its very bytes.

use super::{DecodeError, Decoder, corrupt};
use crate::format::appearance::{AppearanceError, code_appearance};
use crate::format::coder::range;
use crate::format::container::{ChunkInfo, ContainerError, Kind, Preview};
use crate::format::split::segment::InvalidStream;
use crate::image::jpeg::{END, Unsupported, restore};
use crate::mesh::Appearance;

/// A preview that is shown.
#[derive(Debug)]
pub(super) struct Shown {
    number: u32,
    /// The media type of the image itself.
    mime: String,
}

impl Decoder {
    /// Materials or an image.
    pub(super) fn take_picture(&mut self, level: u32, info: ChunkInfo, payload: Vec<u8>) -> Result<(), DecodeError> {
        match (info.kind, &mut self.appearance) {
            (Kind::Appearance, None) => {
                let mut coder = range::Decoder::new(payload);
                let limit = self.options.memory_limit;
                let used = self.reader.front()?.map_or(0, |front| front.memory(level));
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
                let announced = match self.reader.front()? {
                    Some(front) => &front.header().attributes,
                    None => return Err(corrupt(level, "materials before the header")),
                };
                let found = (appearance.materials.len(), appearance.images.len());
                if found != (announced.materials as usize, announced.images as usize) {
                    return Err(corrupt(level, "other materials or images than the header announces"));
                }
                self.pieces = vec![[0; 2]; appearance.images.len()];
                self.previews = appearance.images.iter().map(|_| None).collect();
                self.appearance = Some(appearance);
                self.held = held.saturating_sub(info.memory);
            }
            (Kind::Image, Some(_)) => self.take_piece(level, info, payload)?,
            (Kind::Recipe, Some(_)) => self.take_reconstruction(level, info, &payload)?,
            (Kind::Preview, Some(_)) => self.take_preview(level, payload)?,
            // Offered before its chunk came.
            (Kind::Appearance, Some(_)) => {}
            (Kind::Image | Kind::Recipe, None) => return Err(corrupt(level, "images before materials")),
            _ => {}
        }
        Ok(())
    }

    /// The next piece of an image; without the last one, an end marker makes a file of what is there.
    fn take_piece(&mut self, level: u32, info: ChunkInfo, mut payload: Vec<u8>) -> Result<(), DecodeError> {
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
            self.image_bytes = self.image_bytes.saturating_sub(image.bytes.len() as u64);
            image.bytes = Vec::new();
            image.mime = shown.mime;
        }
        self.image_bytes = self.image_bytes.saturating_add(payload.len() as u64);
        self.afford(level)?;
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
    fn take_preview(&mut self, level: u32, mut payload: Vec<u8>) -> Result<(), DecodeError> {
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
        self.image_bytes = self.image_bytes.saturating_sub(old).saturating_add(new);
        self.afford(level)
    }

    /// The reconstruction of an image that is whole: its very bytes.
    fn take_reconstruction(&mut self, level: u32, info: ChunkInfo, reconstruction: &[u8]) -> Result<(), DecodeError> {
        const DONE: u32 = u32::MAX;
        match self.pieces.get(info.image as usize) {
            Some([DONE, DONE]) => return Ok(()),
            Some([have, all]) if have == all && *all > 0 => {}
            _ => return Err(corrupt(level, "the reconstruction of an image before the image")),
        }
        let limit = self.options.memory_limit;
        let used = self.reader.front()?.map_or(0, |front| front.memory(level)).saturating_add(self.held);
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
