#!/usr/bin/env python3
"""Photoreal scenes with their truth: objects of several materials, path traced by Mitsuba 3 in the light of environment maps.

    pip install mitsuba trimesh networkx scipy pillow
    scripts/photoreal_scenes.py OUT --dvr target/release/dvr --light DIR --meshes DIR [--only vase,gold] [--samples 64]

Mitsuba needs LLVM (19 works, 15 and 16 do not); DRJIT_LIBLLVM_PATH names the library (libLLVM.so.19.1).

The scenes are OUT/vase/vase, OUT/gold/gold, ... Each has 48 views of 400 pixels from all sides, RGBA with straight alpha,
cameras and truth as `dvr synth` writes them. At 64 samples a pixel pictures are noisy, as photographs are.

--light: a folder with the environment maps city.exr, courtyard.exr, forest.exr, interior.exr and studio.exr. Blender
brings these (CC0): datafiles/studiolights/world, in the Debian package blender-data. --meshes: a folder of rocker-arm.obj,
cheburashka.obj and nefertiti.obj (https://github.com/alecjacobson/common-3d-test-models). Vases and bowls are made here.
"""

import argparse
import json
import shutil
import subprocess
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np
import trimesh
from PIL import Image
from scipy.interpolate import CubicSpline

VIEWS = 48
SIZE = 400
# Name: mesh, material, environment map.
SCENES = {
    "vase": ("vase", "glaze", "interior"),
    "white_vase": ("vase", "porcelain", "courtyard"),
    "copper_bowl": ("bowl", "copper", "city"),
    "satin_bowl": ("bowl", "satin", "forest"),
    "gold": ("rocker-arm", "gold", "courtyard"),
    "plaster": ("cheburashka", "plaster", "studio"),
    "satin": ("nefertiti", "satin", "forest"),
}


def spline(points, count):
    """A curve through points, at so many places."""
    points = np.array(points, float)
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    return [tuple(place) for place in CubicSpline(along, points)(np.linspace(0, along[-1], count))]


def straight(start, end, count):
    return [tuple(place) for place in np.linspace(start, end, count)]


def revolved(profile, around=200):
    """A solid of revolution about z; its profile, radius and height, begins and ends on the axis."""
    angles = np.linspace(0, 2 * np.pi, around, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], 1)
    rings = [np.column_stack([radius * circle, np.full(around, height)]) for radius, height in profile[1:-1]]
    vertices = np.vstack([[[0, 0, profile[0][1]]], *rings, [[0, 0, profile[-1][1]]]])
    last = len(vertices) - 1

    def node(ring, turn):
        return 1 + ring * around + turn % around

    faces = []
    for turn in range(around):
        faces.append((0, node(0, turn), node(0, turn + 1)))
        faces.append((last, node(len(rings) - 1, turn + 1), node(len(rings) - 1, turn)))
        for ring in range(len(rings) - 1):
            corners = node(ring, turn), node(ring + 1, turn), node(ring + 1, turn + 1), node(ring, turn + 1)
            faces += [corners[:3], (corners[0], corners[2], corners[3])]
    mesh = trimesh.Trimesh(vertices, faces)
    mesh.fix_normals()
    return mesh


def vase():
    outside = spline([(0.34, 0), (0.42, 0.06), (0.62, 0.45), (0.58, 0.9), (0.34, 1.3), (0.3, 1.5), (0.42, 1.68)], 80)
    inside = spline([(0.37, 1.66), (0.25, 1.5), (0.28, 1.3), (0.51, 0.9), (0.55, 0.45), (0.34, 0.12)], 70)
    below, floor = straight((0.05, 0), (0.3, 0), 8), straight((0.28, 0.08), (0.03, 0.08), 8)
    return revolved([(0, 0), *below, *outside, (0.41, 1.71), (0.385, 1.7), *inside, *floor, (0, 0.08)])


def bowl():
    outside = spline([(0.3, 0), (0.36, 0.05), (0.7, 0.35), (0.85, 0.75)], 60)
    inside = spline([(0.79, 0.76), (0.64, 0.38), (0.3, 0.1)], 50)
    below, floor = straight((0.05, 0), (0.26, 0), 6), straight((0.25, 0.08), (0.03, 0.07), 6)
    return revolved([(0, 0), *below, *outside, (0.83, 0.79), (0.8, 0.79), *inside, *floor, (0, 0.07)])


def loaded(path):
    """A mesh, fine enough for colours at its vertices."""
    mesh = trimesh.load(path, force="mesh")
    mesh.merge_vertices(merge_norm=True, merge_tex=True)
    if len(mesh.vertices) == 0:
        raise SystemExit(f"{path}: no vertices")
    while len(mesh.vertices) < 60_000:
        mesh = mesh.subdivide()
    mesh.visual = trimesh.visual.ColorVisuals()
    return mesh


def waves(points, frequency, seed):
    """Smooth noise of unit variance: a sum of plane waves."""
    random = np.random.default_rng(seed)
    total = np.zeros(len(points))
    for _ in range(24):
        total += np.sin(points @ (random.normal(size=3) * frequency) * 2 * np.pi + random.uniform(0, 2 * np.pi))
    return total / np.sqrt(12)


def material(kind, points):
    """A material, and colours at the vertices where it has such."""
    colors = np.ones((len(points), 3))
    painted = {"type": "mesh_attribute", "name": "vertex_color"}
    if kind == "glaze":
        stripes = np.sin(points[:, 2] * 40) + 0.6 * waves(points, 3, 1) > 0.5
        colors = np.where(stripes[:, None], [0.05, 0.12, 0.45], [0.75, 0.72, 0.65])
        colors = np.where((waves(points, 6, 2) > 0.9)[:, None], [0.6, 0.15, 0.05], colors)
        return {"type": "principled", "base_color": painted, "roughness": 0.15, "specular": 0.6}, colors
    if kind == "satin":
        broad, middle, fine = (waves(points, *wave) for wave in ((4, 3), (12, 4), (40, 5)))
        red, green = 0.4 + 0.06 * broad + 0.03 * fine, 0.33 + 0.05 * middle + 0.03 * fine
        blue = 0.26 + 0.04 * broad - 0.03 * middle + 0.02 * fine
        colors = np.stack([red, green, blue], 1).clip(0.03, 0.9)
        return {"type": "principled", "base_color": painted, "roughness": 0.45, "specular": 0.5}, colors
    plain = {
        "gold": {"type": "roughconductor", "material": "Au", "alpha": 0.2, "distribution": "ggx"},
        "copper": {"type": "roughconductor", "material": "Cu", "alpha": 0.15, "distribution": "ggx"},
        "plaster": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.58, 0.55]}},
        "porcelain": {
            "type": "principled",
            "base_color": {"type": "rgb", "value": [0.75, 0.73, 0.7]},
            "roughness": 0.2,
            "specular": 0.5,
        },
    }
    return plain[kind], colors


def mitsuba_mesh(name, mesh, points, colors, path):
    made = mi.Mesh(name, len(points), len(mesh.faces), has_vertex_normals=True)
    made.add_attribute("vertex_color", 3, colors.astype(np.float32).ravel())
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = points.astype(np.float32).ravel()
    parameters["vertex_normals"] = np.asarray(mesh.vertex_normals, np.float32).ravel()
    parameters["faces"] = np.asarray(mesh.faces, np.uint32).ravel()
    parameters.update()
    made.write_ply(str(path))


def sensor(world, camera):
    """A camera of the layout (image right, down, forward) as one of Mitsuba's (left, up, forward)."""
    scale = np.cbrt(np.linalg.det(world[:3, :3]))
    rotation, translation = world[:3, :3] / scale, world[:3, 3] / scale
    to_world = np.eye(4)
    to_world[:3, :3] = np.stack([-rotation[0], -rotation[1], rotation[2]], 1)
    to_world[:3, 3] = -rotation.T @ translation
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "pixel_format": "rgba", "rfilter": {"type": "box"}}
    return mi.load_dict({
        "type": "perspective",
        "fov": float(2 * np.degrees(np.arctan(1 / camera[0, 0]))),
        "fov_axis": "x",
        "near_clip": 0.01,
        "to_world": mi.ScalarTransform4f(to_world),
        "film": film,
        "sampler": {"type": "independent"},
    })


def srgb(linear):
    return np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def render(name, mesh, kind, light, args, work):
    mesh.export(work / f"{name}.ply")
    (work / "settings.json").write_text(json.dumps({"depth_maps": False, "focal": 2.6}))
    synth = ["synth", work / f"{name}.ply", "--category", name, "--out", args.out]
    sizes = ["--views", VIEWS, "--size", SIZE, "--config", work / "settings.json"]
    subprocess.run([str(argument) for argument in [args.dvr, *synth, *sizes]], check=True)
    scene = args.out / name / name
    truth, cameras = np.load(scene / "pointcloud.npz"), np.load(scene / "cameras.npz")
    points = (mesh.vertices - truth["loc"]) / float(truth["scale"])
    bsdf, colors = material(kind, points)
    mitsuba_mesh(name, mesh, points, colors, work / "mitsuba.ply")
    if bsdf["type"] != "principled":
        bsdf = {"type": "twosided", "inner": bsdf}
    upright = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    traced = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6, "hide_emitters": True},
        "light": {"type": "envmap", "filename": str(args.light / f"{light}.exr"), "to_world": upright},
        "object": {"type": "ply", "filename": str(work / "mitsuba.ply"), "bsdf": bsdf},
    })
    exposure = None
    for view in range(VIEWS):
        world = cameras[f"world_mat_{view}"] @ cameras[f"scale_mat_{view}"]
        seen_by = sensor(world, cameras[f"camera_mat_{view}"])
        picture = np.array(mi.render(traced, sensor=seen_by, spp=args.samples, seed=view))
        alpha = picture[..., 3:].clip(0, 1)
        straight_color = np.where(alpha > 1e-3, picture[..., :3] / np.maximum(alpha, 1e-3), 0)
        if exposure is None:
            exposure = 0.4 / np.percentile(straight_color[alpha[..., 0] > 0.99].mean(-1), 85)
        shown = np.concatenate([srgb((straight_color * exposure).clip(0, 1)), alpha], -1)
        Image.fromarray((255 * shown + 0.5).astype(np.uint8)).save(scene / "image" / f"{view:04d}.png")
        print(f"\r{name}: {view + 1} of {VIEWS}", end="", flush=True)
    # Alpha says what shows the object.
    shutil.rmtree(scene / "mask", ignore_errors=True)
    print()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="where the scenes go")
    parser.add_argument("--dvr", type=Path, default=Path("target/release/dvr"), help="the program")
    parser.add_argument("--light", type=Path, required=True, help="a folder of environment maps")
    parser.add_argument("--meshes", type=Path, help="a folder of meshes")
    parser.add_argument("--only", default=",".join(SCENES), help="these scenes, with commas between them")
    parser.add_argument("--samples", type=int, default=64, help="samples of a pixel")
    args = parser.parse_args()
    made = {"vase": vase, "bowl": bowl}
    names = args.only.split(",")
    for name in names:
        if name not in SCENES:
            parser.error(f"{name}: none of {', '.join(SCENES)}")
        shape, _, light = SCENES[name]
        if shape not in made and args.meshes is None:
            parser.error(f"{name} needs --meshes")
        needed = [args.dvr, args.light / f"{light}.exr"] + ([] if shape in made else [args.meshes / f"{shape}.obj"])
        for file in needed:
            if not file.is_file():
                parser.error(f"{file}: no such file")
    try:
        mi.set_variant("llvm_ad_rgb")
        mi.Float(0)
    except ImportError as problem:
        parser.error(f"Mitsuba does not start ({problem}): set DRJIT_LIBLLVM_PATH to the library of LLVM")
    for name in names:
        shape, kind, light = SCENES[name]
        mesh = made[shape]() if shape in made else loaded(args.meshes / f"{shape}.obj")
        with tempfile.TemporaryDirectory() as work:
            render(name, mesh, kind, light, args, Path(work))


if __name__ == "__main__":
    main()
