#!/usr/bin/env python3
"""Size of defective meshes against the same meshes after repair. For developers; nothing else depends on it.

    pip install pymeshlab
    cargo build --release
    benches/bad/compare.py FOLDER [--program target/release/lodestream] [--ratio 1.15] [--bits 8]

PyMeshLab repairs each mesh of FOLDER: faces that repeat a vertex, duplicate faces and faces without area go, edges of more
than two faces and vertices of several fans are split, vertices of no face go. What it mends is counted. Both are then
encoded on one lattice (12 bits along the original's longest side), positions and faces only. The original may take `ratio` times the bytes of the
repaired mesh and `bits` for each defect. The exit code is 1 where one takes more.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

import pymeshlab

EXTENSIONS = {".off", ".obj", ".ply", ".stl"}


def encode(program, source, target, *lattice):
    """Encode a mesh; what the program and the file say about it."""
    run = lambda *words: json.loads(subprocess.run([program, *map(str, words), "--json"], check=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE).stdout)
    return run("encode", source, "-o", target, "--drop", "all", *lattice), run("info", target)["quantization"]


def repair(source, target):
    """Repair a mesh and write it; the defects mended, by kind. `None` where nothing is left."""
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.load_new_mesh(str(source))
    if meshes.current_mesh().face_number() == 0:
        return None
    counts = lambda: (meshes.current_mesh().vertex_number(), meshes.current_mesh().face_number())
    if source.suffix.lower() == ".stl":
        # The format repeats its vertices; lodestream welds them too.
        meshes.meshing_remove_duplicate_vertices()
    defects = {}
    _, before = counts()
    meshes.meshing_remove_duplicate_faces()
    defects["duplicates"] = before - counts()[1]
    _, before = counts()
    meshes.meshing_remove_null_faces()
    defects["no area"] = before - counts()[1]
    topology = meshes.get_topological_measures()
    defects["edges"] = topology["non_two_manifold_edges"]
    defects["vertices"] = topology["non_two_manifold_vertices"]
    before, _ = counts()
    meshes.meshing_remove_unreferenced_vertices()
    defects["unused"] = before - counts()[0]
    if counts()[1] == 0:
        return None
    meshes.meshing_repair_non_manifold_edges(method="Split Vertices")
    meshes.meshing_repair_non_manifold_vertices(vertdispratio=0)
    # Splitting leaves old copies behind, which are no defects of the original.
    meshes.meshing_remove_unreferenced_vertices()
    meshes.save_current_mesh(str(target), save_polygonal=True)
    return defects


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--program", default="target/release/lodestream")
    parser.add_argument("--ratio", type=float, default=1.15)
    parser.add_argument("--bits", type=float, default=8)
    arguments = parser.parse_args()
    kinds = ["duplicates", "no area", "edges", "vertices", "unused"]
    print(f"{'file':34}" + "".join(f"{kind:>11}" for kind in kinds) + f"{'bytes':>9}{'repaired':>9}{'ratio':>7}{'allowed':>9}")
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for source in sorted(p for p in arguments.folder.iterdir() if p.suffix.lower() in EXTENSIONS):
            original, lattice = encode(arguments.program, source, folder / "original.lods")
            mended = folder / "repaired.obj"
            defects = repair(source, mended)
            if defects is None:
                print(f"{source.name:34} nothing left to compare with")
                continue
            origin = "--origin=" + ",".join(repr(x) for x in lattice["origin"])
            repaired, _ = encode(arguments.program, mended, folder / "repaired.lods", "--position-step", repr(lattice["step"]), origin)
            allowed = arguments.ratio * repaired["bytes"] + arguments.bits / 8 * sum(defects[kind] for kind in kinds)
            verdict = "" if original["bytes"] <= allowed else "  more than allowed"
            failed += bool(verdict)
            numbers = "".join(f"{defects[kind]:>11}" for kind in kinds)
            print(f"{source.name:34}{numbers}{original['bytes']:>9}{repaired['bytes']:>9}{original['bytes'] / repaired['bytes']:>7.3f}{allowed:>9.0f}{verdict}")
    print(f"{failed} of them take more than {arguments.ratio} × the repaired mesh and {arguments.bits:g} bits a defect")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
