"""How far verified points are off themselves: about as far as a right surface is from them.

    python3 scripts/checks/points_floor.py POINTS...

POINTS are NPZ files with `points`. Each point is compared with the plane through its 12 nearest points, where these 12 lie flattest (a third
of all). Where the surface is flat, that is the noise of the point and of the plane; the plane's share (3 of 12 in the variance) is taken
off. Needs NumPy and SciPy.
"""

import sys

import numpy as np
from scipy.spatial import cKDTree

NEIGHBOURS = 12
FLATTEST = 1 / 3


def floor_of(points):
    """Mean and median distance of points from the planes through their neighbours, where these are flattest."""
    _, near = cKDTree(points).query(points, NEIGHBOURS + 1)
    # The first neighbour of a point is itself.
    around = points[near[:, 1:]]
    centre = around.mean(axis=1)
    _, spread, axes = np.linalg.svd(around - centre[:, None])
    off = np.abs(np.einsum("ij,ij->i", points - centre, axes[:, 2]))
    flattest = off[spread[:, 2] <= np.quantile(spread[:, 2], FLATTEST)]
    noise = flattest / np.sqrt(1 + 3 / NEIGHBOURS)
    return noise.mean(), np.median(noise)


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    for path in sys.argv[1:]:
        points = np.load(path)["points"].astype(float)
        mean, median = floor_of(points)
        print(f"{path}: {len(points)} points, mean {mean:.4g}, median {median:.4g}")


if __name__ == "__main__":
    main()
