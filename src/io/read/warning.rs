//! What a reader left out or read otherwise than the file has it, counted.

use std::fmt;

/// Data beside geometry and connectivity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Layer {
    /// Texture coordinates of vertices or corners.
    TextureCoordinates,
    /// Normals of vertices or corners.
    Normals,
    /// Colours of vertices.
    Colours,
    /// Tangents.
    Tangents,
    /// Materials and texture references.
    Materials,
    /// Names of groups, objects and smoothing groups.
    Groups,
    /// The fourth coordinate of OBJ vertices.
    VertexWeights,
    /// The third texture coordinate of OBJ.
    TextureDepth,
    /// Colours of faces.
    FaceColours,
    /// Free-form curves and surfaces.
    FreeForm,
    /// Skins: the mesh comes as it is modelled, not as a joint moves it.
    Skins,
    /// Morph targets.
    MorphTargets,
    /// Animations.
    Animations,
    /// Further attributes of glTF vertices.
    OtherAttributes,
    /// Numbers behind the coordinates of a vertex that are neither announced nor a colour.
    FurtherNumbers,
    /// Names of nodes and meshes in glTF.
    NodeNames,
    /// Names of the solids of an STL.
    SolidNames,
    /// Cameras.
    Cameras,
    /// What programs add to nodes, meshes and scenes of glTF.
    Extras,
}

impl fmt::Display for Layer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Layer::TextureCoordinates => "texture coordinates",
            Layer::Normals => "normals",
            Layer::Colours => "colours",
            Layer::Tangents => "tangents",
            Layer::Materials => "materials",
            Layer::Groups => "names of groups and objects",
            Layer::VertexWeights => "fourth coordinates of vertices",
            Layer::TextureDepth => "third texture coordinates",
            Layer::FaceColours => "colours of faces",
            Layer::FreeForm => "free-form curves and surfaces",
            Layer::Skins => "skins",
            Layer::MorphTargets => "morph targets",
            Layer::Animations => "animations",
            Layer::OtherAttributes => "further vertex attributes",
            Layer::FurtherNumbers => "further numbers behind the coordinates of vertices",
            Layer::NodeNames => "names of nodes and meshes",
            Layer::SolidNames => "names of solids",
            Layer::Cameras => "cameras",
            Layer::Extras => "extras of nodes, meshes and scenes",
        })
    }
}

/// Something a reader left out or read otherwise.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Warning {
    /// Faces of one or two corners.
    SmallFaces {
        /// How many.
        count: u64,
    },
    /// Faces without any corner, left out.
    EmptyFaces {
        /// How many.
        count: u64,
    },
    /// Edges from a vertex to itself (also after welding): the vertex stays, the edge goes.
    PointEdges {
        /// How many.
        count: u64,
    },
    /// Triangles of a strip that repeat a vertex: they only join the parts of the strip.
    StripConnectors {
        /// How many.
        count: u64,
    },
    /// Data beside geometry and connectivity.
    NotCarried {
        /// What it is.
        layer: Layer,
        /// How many records of it, in the file's own units.
        count: u64,
    },
    /// Faces that have values of a layer at some of their corners only: they lose them.
    PartialFaces {
        /// The name of the layer.
        layer: String,
        /// How many faces.
        count: u64,
    },
    /// Values that are NaN or infinite, which is as if there were none.
    NotFiniteValues {
        /// The name of the layer.
        layer: String,
        /// How many values.
        count: u64,
    },
    /// Corners that name a value which is not there, which is as if they named none.
    MissingValues {
        /// The name of the layer.
        layer: String,
        /// How many corners.
        count: u64,
    },
    /// Colours a little outside of 0..1, cut off there.
    ClampedColours {
        /// The name of the layer.
        layer: String,
        /// How many numbers.
        count: u64,
    },
    /// Colours that lie far outside of 0..1 and of any range of whole numbers: kept as numbers without that meaning.
    HighColours {
        /// The name of the layer.
        layer: String,
        /// How many numbers lie outside.
        count: u64,
    },
    /// Vertices with a coordinate that is NaN or infinite, left out as asked, and the faces that used them.
    InvalidVertices {
        /// How many vertices.
        count: u64,
        /// How many faces, edges included.
        faces: u64,
    },
    /// A count in a header that the size of the file disproves.
    WrongCount {
        /// What is counted.
        what: &'static str,
        /// As the header has it.
        announced: u64,
        /// As many as there are.
        found: u64,
    },
    /// Files that the mesh refers to and that are not there, or not what they should be.
    MissingFiles {
        /// `"image"` or `"material library"`.
        what: &'static str,
        /// How many.
        count: u64,
        /// The first of them, as the mesh file names them.
        names: Vec<String>,
    },
    /// Materials that are used but described nowhere: only their names are kept.
    UnknownMaterials {
        /// How many.
        count: u64,
        /// The first of them.
        names: Vec<String>,
    },
    /// Parts of glTF extensions that stand outside materials and textures.
    SkippedExtensions {
        /// Their names.
        names: Vec<String>,
    },
    /// PLY elements of a name that means nothing here.
    SkippedElements {
        /// The name of the element.
        element: String,
        /// How many of it.
        count: u64,
    },
    /// PLY properties that mean nothing here.
    SkippedProperties {
        /// The element they belong to.
        element: String,
        /// Their names.
        names: Vec<String>,
        /// How many elements have them.
        count: u64,
    },
    /// OBJ lines with a keyword that is not one of the format's.
    UnknownStatements {
        /// How many lines.
        count: u64,
        /// The keyword of the first.
        first: String,
        /// Its line, from 1.
        line: u64,
    },
    /// Bytes behind the end of the mesh.
    TrailingBytes {
        /// How many.
        count: u64,
    },
    /// An ASCII STL without its last `endsolid`: it may have been cut.
    UnfinishedSolid,
    /// glTF primitives whose number of indices leaves a rest.
    IncompletePrimitives {
        /// How many primitives.
        count: u64,
    },
    /// glTF meshes outside the default scene.
    UnusedMeshes {
        /// How many.
        count: u64,
    },
}

/// How many names a line lists.
const LISTED: usize = 16;

/// `1 face`, `2 faces`.
pub(crate) fn counted(count: u64, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

fn plural(what: &str) -> String {
    match what.strip_suffix('y') {
        Some(stem) => format!("{stem}ies"),
        None => format!("{what}s"),
    }
}

/// The names that are kept of a longer list.
fn some(names: &[String], count: u64) -> String {
    let more = if count > names.len() as u64 { ", …" } else { "" };
    format!("{}{more}", names.join(", "))
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verb = |count: u64| if count == 1 { "was" } else { "were" };
        match self {
            Warning::SmallFaces { count } => {
                let (faces, verb) = (counted(*count, "face", "faces"), verb(*count));
                write!(f, "{faces} with fewer than three corners {verb} read as edges or points")
            }
            Warning::EmptyFaces { count } => {
                write!(f, "{} without corners {} left out", counted(*count, "face", "faces"), verb(*count))
            }
            Warning::PointEdges { count } => {
                let edges = counted(*count, "edge from a vertex to itself", "edges from a vertex to itself");
                write!(f, "{edges} {} read as a point", verb(*count))
            }
            Warning::StripConnectors { count } => {
                let triangles = counted(*count, "triangle", "triangles");
                write!(f, "{triangles} of strips that repeat a vertex {} left out as connectors", verb(*count))
            }
            Warning::NotCarried { layer, count } => {
                write!(f, "{layer} are not carried ({} left out)", counted(*count, "record", "records"))
            }
            Warning::PartialFaces { layer, count } => {
                let (faces, verb) = (counted(*count, "face", "faces"), if *count == 1 { "has" } else { "have" });
                write!(f, "{faces} {verb} values of `{layer}` at some corners only; they were left out")
            }
            Warning::NotFiniteValues { layer, count } => {
                let values = counted(*count, "value", "values");
                write!(f, "{values} of `{layer}` not finite and left out")
            }
            Warning::MissingValues { layer, count } => {
                let corners = counted(*count, "corner names a value", "corners name values");
                write!(f, "{corners} of `{layer}` that the file does not have; they are read as without")
            }
            Warning::ClampedColours { layer, count } => {
                let numbers = counted(*count, "number", "numbers");
                write!(f, "{numbers} of `{layer}` a little outside of 0..1 {} cut off there", verb(*count))
            }
            Warning::HighColours { layer, count } => {
                let numbers = counted(*count, "number", "numbers");
                write!(f, "{numbers} of `{layer}` far outside of 0..1: all of it is kept as numbers, not as colours")
            }
            Warning::InvalidVertices { count, faces } => {
                let vertices = counted(*count, "vertex", "vertices");
                let faces = counted(*faces, "face or edge that uses them", "faces and edges that use them");
                write!(f, "{vertices} without a finite place left out, with {faces}")
            }
            Warning::WrongCount { what, announced, found } => {
                write!(
                    f,
                    "the header announces {announced} {what}, the size of the file tells {found}; these were read"
                )
            }
            Warning::MissingFiles { what, count, names } => {
                let (one, many) = (format!("{what} not found"), format!("{} not found", plural(what)));
                write!(f, "{}: {}", counted(*count, &one, &many), some(names, *count))
            }
            Warning::UnknownMaterials { count, names } => {
                let materials = counted(*count, "material is", "materials are");
                write!(f, "{materials} used but not described; the name is kept: {}", some(names, *count))
            }
            Warning::SkippedExtensions { names } => {
                write!(f, "glTF extensions outside of materials and textures skipped: {}", names.join(", "))
            }
            Warning::SkippedElements { element, count } => {
                write!(f, "{} `{element}` skipped", counted(*count, "PLY element", "PLY elements"))
            }
            Warning::SkippedProperties { element, names, count } => {
                let records = counted(*count, "record", "records");
                let (all, listed) = (names.len() as u64, &names[..names.len().min(LISTED)]);
                write!(f, "PLY properties of `{element}` skipped ({records}): {}", some(listed, all))
            }
            Warning::UnknownStatements { count, first, line } => {
                let lines = counted(*count, "line", "lines");
                write!(f, "{lines} with an unknown statement skipped (the first: `{first}` on line {line})")
            }
            Warning::TrailingBytes { count } => {
                write!(f, "{} behind the end of the mesh ignored", counted(*count, "byte", "bytes"))
            }
            Warning::UnfinishedSolid => f.write_str("the last solid has no `endsolid`; the file may have been cut"),
            Warning::IncompletePrimitives { count } => {
                let primitives = counted(*count, "primitive has", "primitives have");
                write!(f, "{primitives} indices left over that make no whole element")
            }
            Warning::UnusedMeshes { count } => {
                write!(f, "{} outside the default scene left out", counted(*count, "mesh", "meshes"))
            }
        }
    }
}
