"""Measures a mesh of a rendered scene by DTU's protocol, once by `dvr eval` and once by the public evaluation in Python.

    python3 scripts/checks/dtu.py MESH SCENE EVALUATION OUT

MESH is what `dvr train SCENE` made, SCENE a rendered scene with `pointcloud.npz`, EVALUATION the file eval.py of
https://github.com/jzhangbs/DTUeval-python. Evaluation data is made of the scene's true points: the object is 200 mm wide,
the scanner saw three quarters of the cells of its observation mask, and the table cuts a part of the object off. Needs NumPy, SciPy and what
EVALUATION needs (scikit-learn, tqdm, open3d), and `dvr` on the PATH, or in $DVR. Prints accuracy, completeness and their mean
by each, in millimetres; the public evaluation thins points in another order at each call, so it is called several times.
"""

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.io import savemat

from ply import read_ply

SCAN, CELL, WIDTH, CALLS = 24, 2.0, 200.0, 3


def write_ply(path, vertices, faces=None):
    """Vertices, and triangles where there are some."""
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    if faces is not None:
        header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\n"
    with open(path, "wb") as file:
        file.write((header + "end_header\n").encode())
        file.write(vertices.astype("<f4").tobytes())
        if faces is not None:
            for face in faces:
                file.write(struct.pack("<Biii", 3, *face))


def main():
    mesh, scene, evaluation, out = (Path(argument) for argument in sys.argv[1:5])
    points = np.load(scene / "pointcloud.npz")["points"].astype(np.float64)
    vertices, faces = read_ply(mesh)
    centre, scale = (points.min(0) + points.max(0)) / 2, WIDTH / np.ptp(points, 0).max()
    points, vertices = (points - centre) * scale, (vertices - centre) * scale
    reference = out / "reference"
    for folder in ["ObsMask", "Points/stl"]:
        (reference / folder).mkdir(parents=True, exist_ok=True)
    low, high = points.min(0) - 5, points.max(0) + 5
    shape = np.ceil((high - low) / CELL).astype(int) + 1
    x, y, _ = np.indices(shape)
    observed = ((x + y) % 40 < 30).astype(np.uint8)
    savemat(reference / f"ObsMask/ObsMask{SCAN}_10.mat", {"ObsMask": observed, "BB": np.stack([low, high]), "Res": CELL})
    height = np.quantile(points[:, 2], 0.2)
    savemat(reference / f"ObsMask/Plane{SCAN}.mat", {"P": np.array([[0.0], [0.0], [1.0], [-height]])})
    write_ply(reference / f"Points/stl/stl{SCAN:03}_total.ply", points)
    write_ply(out / "mesh.ply", vertices, faces)

    def named(figures):
        return "  ".join(f"{name} {value:.4f}" for name, value in zip(["accuracy", "completeness", "mean"], figures))

    public = []
    for _ in range(CALLS):
        call = [sys.executable, evaluation, "--data", out / "mesh.ply", "--scan", str(SCAN), "--dataset_dir", reference]
        said = subprocess.run(call + ["--vis_out_dir", out], check=True, capture_output=True, text=True).stdout
        public.append([float(word) for word in said.split()[-3:]])
        print("public:", named(public[-1]), flush=True)
    own = []
    for seed in range(CALLS):
        figures = out / f"dvr{seed}.json"
        call = [os.environ.get("DVR", "dvr"), "eval", out / "mesh.ply", "--protocol", "dtu", "--reference", reference]
        more = ["--scan", str(SCAN), "--seed", str(seed), "--json", figures, "--overwrite"]
        subprocess.run(call + more, check=True, capture_output=True)
        found = json.loads(figures.read_text())["dtu"]
        own.append([found["accuracy"]["mean"], found["completeness"]["mean"], found["overall"]])
        print("dvr:   ", named(own[-1]), flush=True)
    print("difference of means:", named(np.mean(own, 0) - np.mean(public, 0)))


if __name__ == "__main__":
    main()
