"""Distance and normals of meshes on the outside of an object, apart from its hollows.

    python3 scripts/checks/outside.py TRUTH MESH...

All are PLY files, TRUTH of the true surface, with faces that turn outwards. Needs NumPy and SciPy. Outside is where three quarters of the
directions that the true surface faces are free of itself. Prints, in edges of the object's box: distances from the true surface there to
each mesh and normals at these places, then the same from the mesh to the truth, where the nearest true place is outside.
"""

import sys

import numpy as np
from scipy.spatial import cKDTree

from ply import read_ply

VOXELS = 96
MARGIN = 4
DIRECTIONS = 96
FREE = 0.75
PLACES = 30_000
DENSE = 1_500_000


def surface(path, count, rng):
    """Places that are uniform on a mesh, and its normals there."""
    vertices, faces = read_ply(path)
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    cross = np.cross(b - a, c - a)
    twice = np.linalg.norm(cross, axis=1)
    of = rng.choice(len(faces), count, p=twice / twice.sum())
    far, side = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1 - far, far * (1 - side), far * side], 1)
    places = np.einsum("nk,nkd->nd", weights, np.stack([a[of], b[of], c[of]], 1))
    return places, cross[of] / np.maximum(twice[of], 1e-300)[:, None]


def free_share(places, normals, voxels, voxel_of, size, rng):
    """The share of the directions that places face in which no voxel of the surface lies."""
    directions = rng.normal(size=(DIRECTIONS, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    free, asked = np.zeros(len(places)), np.zeros(len(places))
    for direction in directions:
        # Flat rays would meet the voxels of the place itself.
        faced = normals @ direction > 0.15
        start = places[faced] + 2.2 * size * normals[faced]
        is_hit = np.zeros(len(start), bool)
        for step in np.arange(0, 1.5 * VOXELS, 0.7):
            at = voxel_of(start + step * size * direction)
            known = ((at >= 0) & (at < len(voxels))).all(1)
            is_hit |= known & voxels[tuple(np.clip(at, 0, len(voxels) - 1).T)]
        free[faced] += ~is_hit
        asked[faced] += 1
    return free / np.maximum(asked, 1)


def nearest(places, tree, others, normals):
    """Which of the other places is nearest, and how far its tangent plane, or it itself where that is less sure."""
    away, of = tree.query(places)
    return of, np.minimum(np.abs(np.einsum("ij,ij->i", places - others[of], normals[of])), away)


def main():
    rng = np.random.default_rng(0)
    dense, dense_normals = surface(sys.argv[1], DENSE, rng)
    corner = dense.min(0)
    edge = (dense.max(0) - corner).max()
    size = edge / VOXELS

    def voxel_of(at):
        return np.floor((at - corner) / size).astype(int) + MARGIN

    voxels = np.zeros((VOXELS + 2 * MARGIN + 1,) * 3, bool)
    voxels[tuple(voxel_of(dense).T)] = True
    truth, normals = dense[:PLACES], dense_normals[:PLACES]
    outside = free_share(truth, normals, voxels, voxel_of, size, rng) >= FREE
    print(f"outside: {outside.mean():.0%} of the surface")
    true_tree = cKDTree(truth)
    for path in sys.argv[2:]:
        places, found = surface(path, DENSE, rng)
        of, off = nearest(truth[outside], cKDTree(places), places, found)
        alike = np.abs(np.einsum("ij,ij->i", found[of], normals[outside]))
        back, back_off = nearest(places[:PLACES], true_tree, truth, normals)
        there = outside[back]
        back_alike = np.abs(np.einsum("ij,ij->i", found[:PLACES][there], normals[back][there]))
        print(f"{path}: to the mesh {off.mean() / edge:.4f}, normals {alike.mean():.3f}, "
              f"{(alike > np.cos(np.radians(10))).mean():.0%} within 10 degrees; "
              f"from the mesh {back_off[there].mean() / edge:.4f}, normals {back_alike.mean():.3f}")


if __name__ == "__main__":
    main()
