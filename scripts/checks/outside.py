"""Distance and normals of meshes on the outside of an object, apart from its hollows.

    python3 scripts/checks/outside.py TRUTH MESH...

All are PLY files, TRUTH of the true surface, with faces that turn outwards. Needs NumPy and SciPy. Outside is where three quarters of the
directions that the true surface faces are free of itself. Prints, in the longest edge of the object's box: the mean distance from places of
the true surface there to each mesh, and the mean cosine between their normals and those of the mesh nearby; then the same from the mesh to
the true surface, for places whose nearest true place is outside.
"""

import sys

import numpy as np
from scipy.spatial import cKDTree

from ply import read_ply
from points import distances

VOXELS = 96
MARGIN = 4
DIRECTIONS = 96
FREE = 0.75
PLACES = 30_000
DENSE = 1_500_000


def sampled(mesh, count):
    """Places that are uniform on a mesh, and its normals there."""
    rng = np.random.default_rng(0)
    vertices, faces = mesh
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    cross = np.cross(b - a, c - a)
    twice = np.linalg.norm(cross, axis=1)
    of = rng.choice(len(faces), count, p=twice / twice.sum())
    far, side = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1 - far, far * (1 - side), far * side], 1)
    places = np.einsum("nk,nkd->nd", weights, np.stack([a[of], b[of], c[of]], 1))
    return places, cross[of] / np.maximum(twice[of], 1e-300)[:, None]


def free_share(places, normals, voxels, voxel_of, size):
    """The share of the directions that places face in which no voxel of the surface lies."""
    directions = np.random.default_rng(0).normal(size=(DIRECTIONS, 3))
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


def main():
    true_mesh = read_ply(sys.argv[1])
    dense, dense_normals = sampled(true_mesh, DENSE)
    corner = dense.min(0)
    edge = (dense.max(0) - corner).max()
    size = edge / VOXELS

    def voxel_of(at):
        return np.floor((at - corner) / size).astype(int) + MARGIN

    voxels = np.zeros((VOXELS + 2 * MARGIN + 1,) * 3, bool)
    voxels[tuple(voxel_of(dense).T)] = True
    truth, normals = dense[:PLACES], dense_normals[:PLACES]
    outside = free_share(truth, normals, voxels, voxel_of, size) >= FREE
    print(f"outside: {outside.mean():.0%} of the surface")
    near_truth, near_dense = cKDTree(truth), cKDTree(dense)
    for path in sys.argv[2:]:
        mesh = read_ply(path)
        places, found = sampled(mesh, DENSE)
        to_mesh = distances(truth[outside], *mesh)
        cosine = np.einsum("ij,ij->i", found[cKDTree(places).query(truth[outside])[1]], normals[outside])
        places, found = places[:PLACES], found[:PLACES]
        is_outside = outside[near_truth.query(places)[1]]
        from_mesh = distances(places[is_outside], *true_mesh)
        back = np.einsum("ij,ij->i", dense_normals[near_dense.query(places[is_outside])[1]], found[is_outside])
        print(f"{path}: to the mesh {to_mesh.mean() / edge:.4f}, normals {cosine.mean():.3f}; "
              f"from the mesh {from_mesh.mean() / edge:.4f}, normals {back.mean():.3f}")


if __name__ == "__main__":
    main()
