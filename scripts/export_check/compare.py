"""Compares pictures and figures of Blender and three.js with ours, by Blender's Python.

    blender --background --factory-startup --python compare.py -- MESH.glb REFERENCE OUT ORBIT...

Where MESH.usdz lies beside, what three.js makes of it lies in OUT/usdz.
REFERENCE has the extent that is expected: a PLY as this program writes it, or the GLB itself.
"""

import json
import os
import struct
import sys

import bpy
import numpy as np

mesh_file, reference, out, *orbits = sys.argv[sys.argv.index("--") + 1 :]

programs = ["blender", "three"] + ["usdz"] * os.path.isfile(os.path.splitext(mesh_file)[0] + ".usdz")

# Pixels along the edge of the block that is averaged.
BLOCK = 4

# The least that is taken for the same picture: decibels, and the silhouettes' intersection over union.
LEAST_PSNR, LEAST_IOU = 35.0, 0.998

# The largest difference of extents, as a share of the longest edge: single precision.
EXTENT = 1e-6

# Differences are shown so many times larger.
SHOWN = 8.0

failures = []


def check(holds, what):
    print(f"{'ok' if holds else 'FAILED'} {what}")
    if not holds:
        failures.append(what)


def picture(path):
    """Rows from below, four channels in [0, 1]."""
    image = bpy.data.images.load(os.path.abspath(path))
    width, height = image.size
    pixels = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)


def on_white(rgba):
    """Colours on white, and where the object is."""
    covered = rgba[..., 3] > 0.5
    return np.where(covered[..., None], rgba[..., :3], 1.0).astype(np.float32), covered


def averaged(pixels):
    height, width = pixels.shape[:2]
    blocks = pixels.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, -1)
    return blocks.mean(axis=(1, 3))


def ours(orbit, name):
    """Our picture has no alpha; no normal is white, which is the background of the picture of normals."""
    color = picture(os.path.join(out, "ours", orbit, name))[..., :3]
    normals = picture(os.path.join(out, "ours", orbit, name.replace(".png", "_normal.png")))[..., :3]
    return color, np.any(normals < 1.0, axis=-1)


def psnr(a, b, where=None):
    error = (a - b) ** 2
    mean = error.mean() if where is None else error[where].mean()
    return float(-10.0 * np.log10(max(float(mean), 1e-12)))


def save(path, pixels):
    height, width = pixels.shape[:2]
    image = bpy.data.images.new("sheet", width, height)
    rgba = np.ones((height, width, 4), dtype=np.float32)
    rgba[..., :3] = np.clip(pixels, 0.0, 1.0)
    image.pixels.foreach_set(rgba.ravel())
    image.filepath_raw, image.file_format = path, "PNG"
    image.save()
    bpy.data.images.remove(image)


def compare_pictures():
    rows = []
    os.makedirs(os.path.join(out, "sheets"), exist_ok=True)
    for orbit in orbits:
        with open(os.path.join(out, "ours", orbit, "transforms.json")) as file:
            names = [frame["file_path"] for frame in json.load(file)["frames"]]
        for name in names:
            color, covered = ours(orbit, name)
            mean, object_share = averaged(color), averaged(covered[..., None].astype(np.float32))[..., 0]
            sheet = [mean]
            for program in programs:
                other_color, other_covered = on_white(picture(os.path.join(out, program, orbit, name)))
                other = averaged(other_color)
                other_share = averaged(other_covered[..., None].astype(np.float32))[..., 0]
                where = (object_share > 0) | (other_share > 0)
                union = np.logical_or(covered, other_covered).sum()
                rows.append(
                    {
                        "program": program,
                        "orbit": orbit,
                        "picture": name,
                        "psnr": psnr(mean, other),
                        "psnr_object": psnr(mean, other, where),
                        "iou": float(np.logical_and(covered, other_covered).sum() / max(union, 1)),
                        "largest_difference": float(np.abs(mean - other).max()),
                    }
                )
                sheet += [other, 1.0 - SHOWN * np.abs(mean - other)]
            save(os.path.join(out, "sheets", f"{orbit}_{name}"), np.concatenate(sheet, axis=1))
    return rows


def extent_of_ply(path):
    """Smallest and largest coordinates of the vertices of a binary PLY, whose first properties are x, y and z."""
    sizes = {"float": 4, "double": 8, "uchar": 1, "ushort": 2, "short": 2, "int": 4, "uint": 4}
    with open(path, "rb") as file:
        count, stride, is_vertex = 0, 0, False
        while True:
            words = file.readline().decode().split()
            if words[0] == "end_header":
                break
            if words[0] == "element":
                is_vertex = words[1] == "vertex"
                count = int(words[2]) if is_vertex else count
            if words[0] == "property" and is_vertex:
                stride += sizes[words[1]]
        rows = np.frombuffer(file.read(count * stride), dtype=np.uint8).reshape(count, stride)
    places = np.ascontiguousarray(rows[:, :12]).view("<f4")
    return places.min(axis=0), places.max(axis=0)


def extent_of_glb(path):
    with open(path, "rb") as file:
        head = file.read(20)
        gltf = json.loads(file.read(struct.unpack("<I", head[12:16])[0]))
    positions = [p["attributes"]["POSITION"] for mesh in gltf["meshes"] for p in mesh["primitives"]]
    accessors = [gltf["accessors"][index] for index in positions]
    return np.min([a["min"] for a in accessors], axis=0), np.max([a["max"] for a in accessors], axis=0)


def compare_extents(scenes):
    low, high = extent_of_ply(reference) if reference.endswith(".ply") else extent_of_glb(reference)
    allowed = EXTENT * float((high - low).max())
    for program, scene in scenes.items():
        expected = low, high
        if program == "blender":
            # (x, y, z) becomes (x, -z, y).
            expected = np.array([low[0], -high[2], low[1]]), np.array([high[0], -low[2], high[1]])
        off = max(np.abs(np.array(scene["low"]) - expected[0]).max(), np.abs(np.array(scene["high"]) - expected[1]).max())
        size = " x ".join(f"{edge:.6g}" for edge in high - low)
        if program == "blender":
            check(scene["scale_length"] == 1.0, "blender: a unit of the file is a unit of Blender, a metre")
        check(off <= allowed, f"{program}: the extent is that of {os.path.basename(reference)}, {size}; off by {off:.2g}")


def compare_names(scenes):
    with open(mesh_file, "rb") as file:
        head = file.read(20)
        gltf = json.loads(file.read(struct.unpack("<I", head[12:16])[0]))
    unlit = all("KHR_materials_unlit" in m.get("extensions", {}) for m in gltf["materials"])
    # An unlit material has no use for its normal map, and programs leave that out.
    base = [m["pbrMetallicRoughness"].get("baseColorTexture") for m in gltf["materials"]]
    base = [texture for texture in base if texture]
    shown = {**gltf, "images": [gltf["images"][gltf["textures"][texture["index"]]["source"]] for texture in base]}
    for program, scene in ((program, scenes[program]) for program in ("blender", "three")):
        for kind, names in scene["names"].items():
            # three.js knows meshes by the names of their nodes.
            expected = [item.get("name") for item in shown.get(kind, [])]
            check(names == expected, f"{program}: names of {kind}: {', '.join(map(str, names))}")
        check(scene["unlit"] == unlit, f"{program}: the material is {'un' if scene['unlit'] else ''}lit")
    faces = sum(gltf["accessors"][p["indices"]]["count"] // 3 for mesh in gltf["meshes"] for p in mesh["primitives"])
    for program, scene in scenes.items():
        check(scene["triangles"] == faces, f"{program}: {scene['triangles']} of {faces} faces")


def main():
    scenes = {}
    for program in programs:
        with open(os.path.join(out, program, "scene.json")) as file:
            scenes[program] = json.load(file)
    compare_names(scenes)
    compare_extents(scenes)
    rows = compare_pictures()
    print("| program | picture | PSNR, dB | within silhouettes, dB | silhouettes, IoU | largest difference of 255 |")
    print("|---|---|---|---|---|---|")
    for row in rows:
        name = f"{row['orbit']} {row['picture'].split('_')[1].split('.')[0]}"
        print(
            f"| {row['program']} | {name} | {row['psnr']:.1f} | {row['psnr_object']:.1f} | {row['iou']:.5f} "
            f"| {255 * row['largest_difference']:.0f} |"
        )
    for program in scenes:
        of_program = [row for row in rows if row["program"] == program]
        worst, iou = min(row["psnr_object"] for row in of_program), min(row["iou"] for row in of_program)
        check(worst > LEAST_PSNR, f"{program}: {worst:.1f} dB within silhouettes at the worst, more than {LEAST_PSNR:g}")
        check(iou > LEAST_IOU, f"{program}: silhouettes {iou:.5f} alike at the worst, more than {LEAST_IOU:g}")
    with open(os.path.join(out, "figures.json"), "w") as file:
        json.dump({"scenes": scenes, "pictures": rows, "failures": failures}, file, indent=2)
    sys.exit(1 if failures else 0)


main()
