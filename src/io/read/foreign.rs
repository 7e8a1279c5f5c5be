//! Files that are no mesh for us: what they are, and what to do with them.

/// What a file of that extension is, and what to do with it; `None` for one that is not known here.
pub(super) fn advice(extension: &str) -> Option<(&'static str, &'static str)> {
    const POINTS: &str = "make a mesh of it (MeshLab, CloudCompare) and export that as .ply";
    const SCENE: &str = "export it as .glb (Blender, or the program that made it)";
    const ARCHIVE: &str = "unpack it and name the mesh inside";
    let lower = extension.to_ascii_lowercase();
    Some(match lower.as_str() {
        "las" | "laz" => ("a LAS point cloud, which has no faces", POINTS),
        "e57" => ("an E57 point cloud, which has no faces", POINTS),
        "pcd" => ("a PCL point cloud, which has no faces", POINTS),
        "xyz" | "pts" | "ptx" | "asc" => ("a list of points, which has no faces", POINTS),
        "fbx" => ("an FBX scene", SCENE),
        "dae" => ("a COLLADA scene", SCENE),
        "3mf" => ("a 3MF model", "export it as .stl or .ply (the slicer, or MeshLab)"),
        "usd" | "usda" | "usdc" | "usdz" => ("a USD scene", SCENE),
        "wrl" | "vrml" | "x3d" => ("a VRML or X3D scene", "export it as .ply or .glb (MeshLab, Blender)"),
        "step" | "stp" | "iges" | "igs" => (
            "a CAD model of surfaces, not of triangles",
            "export it as .stl or .glb (FreeCAD, or the program that made it)",
        ),
        "blend" | "max" | "ma" | "mb" | "c4d" | "skp" | "3ds" => ("a file of a modelling program", SCENE),
        "b3dm" | "i3dm" | "cmpt" => {
            ("a tile of 3D Tiles", "take out the mesh with `3d-tiles-tools b3dmToGlb -i IN.b3dm -o OUT.glb`")
        }
        "pnts" => ("a tile of points of 3D Tiles, which has no faces", POINTS),
        "zip" | "7z" | "rar" | "tar" | "tgz" | "txz" | "kmz" => ("an archive", ARCHIVE),
        "bz2" | "lzma" | "lz4" | "z" | "br" => {
            ("a packed file", "unpack it first; .gz, .zst and .xz are unpacked here")
        }
        "lods" => {
            ("a .lods file already", "see it with `lodestream info`, or make a mesh of it with `lodestream decode`")
        }
        "mtl" => ("a material library", "name the .obj that uses it"),
        "bin" => ("the data of a glTF file, perhaps", "name the .gltf that uses it"),
        _ => return None,
    })
}
