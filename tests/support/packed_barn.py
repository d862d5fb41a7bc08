"""Two cylinders and one path as the packed data of the BARN benchmark."""

import gzip
import json

CENTERS_M = [(-4.425, 0.075), (-0.075, 9.525)]
CELLS = [[15, 0], [15, 20], [18, 24]]


def packed(folder, numbers):
    folder.mkdir(parents=True)
    rows = "".join(f"{number},{x},{y}\n" for number in numbers for x, y in CENTERS_M)
    (folder / "barn-cylinders.csv.gz").write_bytes(gzip.compress(f"world,x,y\n{rows}".encode()))
    (folder / "barn-paths.json.gz").write_bytes(gzip.compress(json.dumps({str(n): CELLS for n in numbers}).encode()))
    return folder
