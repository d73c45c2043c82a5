"""PLY files as `dvr` writes them."""

import numpy as np

KINDS = {"float": "<f4", "uchar": "u1", "int": "<i4", "uint": "<u4", "ushort": "<u2"}


def read_ply(path):
    """Vertices and triangles of a PLY file as `dvr` writes it."""
    with open(path, "rb") as file:
        elements = []
        while (line := file.readline().decode().split()) != ["end_header"]:
            if line[0] == "element":
                elements.append((line[1], int(line[2]), []))
            elif line[0] == "property" and line[1] == "list":
                elements[-1][2].append(("count", KINDS[line[2]]))
                elements[-1][2].append(("corners", KINDS[line[3]], 3))
            elif line[0] == "property":
                elements[-1][2].append((line[2], KINDS[line[1]]))
        read = {name: np.fromfile(file, np.dtype(fields), count) for name, count, fields in elements}
    vertices = np.stack([read["vertex"][axis] for axis in "xyz"], -1).astype(np.float64)
    return vertices, read["face"]["corners"].astype(np.int32) if "face" in read else None
