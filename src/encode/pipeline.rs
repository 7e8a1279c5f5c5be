//! From a mesh to its finished file, in the one order that makes sense: images of other formats become JPEG, previews are made,
//! mesh and images are encoded, chunks put in order, and what belongs behind all else is appended.
//!
//! The command line, batch jobs, reports and benches all go this way.

use super::assemble::assemble;
use super::cost::Engine;
use super::quality_order::{self, Order, ScheduleError, Scheduled};
use super::{Control, EncodeError, EncodeOptions, Encoded};
use crate::format::container::Chunk;
use crate::image::jpeg::Exactness;
use crate::image::preview::{Previews, add_previews};
use crate::image::recompress::{Recompressed, Textures, recompress};
use crate::mesh::{Appearance, Mesh};
use thiserror::Error;

/// What the user chooses for the whole way.
#[derive(Clone, Debug, PartialEq)]
pub struct Pipeline {
    /// How mesh and images are encoded. Its order of chunks counts where [`Pipeline::order`] is not by quality.
    pub encode: EncodeOptions,
    /// What becomes of images that are no JPEG.
    pub textures: Textures,
    /// Which small pictures stand in for images until their first piece is there.
    pub previews: Previews,
    /// The order of the chunks.
    pub order: Order,
    /// How closely the order by quality looks.
    pub looks: quality_order::Options,
}

impl Default for Pipeline {
    fn default() -> Self {
        Pipeline::new(EncodeOptions::default())
    }
}

/// Why a mesh did not become a file.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// It could not be encoded.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// Its chunks could not be put in order.
    #[error(transparent)]
    Order(#[from] ScheduleError),
}

/// A chunk of the caller's that stands behind all others, made for the number of the full level.
pub type Trailer<'a> = &'a dyn Fn(u32) -> Chunk;

impl Pipeline {
    /// The whole way with these options: images as they say, previews where they help, chunks in the options' own order.
    pub fn new(encode: EncodeOptions) -> Self {
        Pipeline {
            textures: Textures::beside(encode.images),
            previews: Previews::default(),
            order: Order::Fixed(encode.schedule),
            looks: quality_order::Options::default(),
            encode,
        }
    }

    /// Whether image bytes come back as they were.
    pub fn exactness(&self) -> Exactness {
        self.encode.images
    }

    /// Make the images of a mesh what the file will hold: JPEG where that is wanted, with previews. Returns what became of images
    /// that were no JPEG.
    pub fn prepare(&self, appearance: &mut Appearance) -> Vec<Recompressed> {
        let recompressed = recompress(appearance, self.textures);
        add_previews(appearance, self.previews);
        recompressed
    }

    /// Encode a mesh whose images were prepared. The file is written once; [`Pipeline::arrange`] has yet to put its chunks in order if
    /// that goes by quality, and then appends `trailer` too: the mesh need not be kept for it.
    ///
    /// # Errors
    /// [`EncodeError`].
    pub fn encode(
        &self,
        mesh: &Mesh,
        engine: Engine,
        trailer: Option<Trailer>,
        control: Control,
    ) -> Result<Encoded, EncodeError> {
        let mut options = self.encode.clone();
        if let Order::Fixed(schedule) = self.order {
            options.schedule = schedule;
        }
        let mut draft = assemble(mesh, &options, engine, control)?;
        if let (Some(trailer), Order::Fixed(_)) = (trailer, self.order) {
            let chunk = trailer(draft.full_level());
            draft.append(chunk);
        }
        Ok(draft.write()?)
    }

    /// Put the chunks of an encoded file in the order by quality, where that is asked for, and append `trailer`. `progress` gets the number
    /// of states that were drawn, and about how many there will be. The file that comes out lies in `encoded`.
    ///
    /// # Errors
    /// [`ScheduleError`].
    pub fn arrange(
        &self,
        encoded: &mut Encoded,
        trailer: Option<Trailer>,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Option<Scheduled>, ScheduleError> {
        if self.order != Order::Quality {
            return Ok(None);
        }
        let mut scheduled = quality_order::with_trailer(&encoded.bytes, &self.looks, trailer, progress)?;
        encoded.bytes = std::mem::take(&mut scheduled.bytes);
        Ok(Some(scheduled))
    }

    /// All of it, on the processor.
    ///
    /// # Errors
    /// [`PipelineError`].
    pub fn run(&self, mesh: &mut Mesh, control: Control) -> Result<Encoded, PipelineError> {
        self.prepare(&mut mesh.appearance);
        let mut encoded = self.encode(mesh, Engine::default(), None, control)?;
        self.arrange(&mut encoded, None, &|_, _| {})?;
        Ok(encoded)
    }
}
