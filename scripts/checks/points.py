"""Distances from verified points to a mesh, apart from `dvr eval --points`, and beside it.

    python3 scripts/checks/points.py MESH POINTS

MESH is a PLY file in the coordinates of the scene's files, POINTS an NPZ file with `points`. Needs NumPy and SciPy, and `dvr` on the PATH,
or in $DVR. Each distance is the least over all triangles that can be nearest: those whose ball around the corners reaches as near as the
nearest corner does. Prints mean, median and the 90 % quantile by both.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ply import read_ply


def on_segment(point, a, b):
    """The nearest places of segments to a point."""
    along = b - a
    share = np.einsum("ij,ij->i", point - a, along) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)
    return a + along * np.clip(share, 0, 1)[:, None]


def to_triangles(point, a, b, c):
    """The distance of a point to the nearest of some triangles."""
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    height = np.einsum("ij,ij->i", point - a, normal) / np.maximum(length, 1e-300)
    foot = point - normal * (height / np.maximum(length, 1e-300))[:, None]
    corners = [(a, b), (b, c), (c, a)]
    is_inside = length > 0
    for p, q in corners:
        is_inside &= np.einsum("ij,ij->i", np.cross(q - p, foot - p), normal) >= 0
    edges = np.min([np.linalg.norm(point - on_segment(point, p, q), axis=1) for p, q in corners], axis=0)
    return np.where(is_inside, np.abs(height), edges).min()


def distances(places, vertices, faces):
    """Distances of places to a mesh."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    middles = (a + b + c) / 3
    radius = max(np.linalg.norm(corner - middles, axis=1).max() for corner in (a, b, c))
    near_corner, near_middle = cKDTree(vertices[np.unique(faces)]), cKDTree(middles)
    most = near_corner.query(places)[0] + radius
    candidates = near_middle.query_ball_point(places, most * (1 + 1e-9))
    return np.array([to_triangles(p, a[of], b[of], c[of]) for p, of in zip(places, candidates)])


def say(who, figures):
    """A line of figures."""
    names = ["mean", "median", "90 % below"]
    print(f"{who:6}" + "".join(f"{name} {figure:.6f}  " for name, figure in zip(names, figures)))


def main():
    mesh, points = Path(sys.argv[1]), Path(sys.argv[2])
    vertices, faces = read_ply(mesh)
    found = distances(np.load(points)["points"].astype(np.float64), vertices, faces)
    say("apart", [found.mean(), *np.quantile(found, [0.5, 0.9])])
    with tempfile.TemporaryDirectory() as folder:
        figures = Path(folder) / "figures.json"
        call = [os.environ.get("DVR", "dvr"), "eval", mesh, "--points", points, "--json", figures]
        subprocess.run(call, check=True, capture_output=True)
        found = json.loads(figures.read_text())["points"]["distances"]
        say("dvr", [found[name] for name in ("mean", "median", "quantile_90")])


if __name__ == "__main__":
    main()
