"""Reader of packed replies of the explorer."""

import json

import numpy as np


def unpacked(content):
    """Read a packed reply as header and arrays."""
    line, _, body = content.partition(b"\n")
    header = json.loads(line)
    arrays = {}
    for name, place in header["arrays"].items():
        count = int(np.prod(place["shape"]))
        array = np.frombuffer(body, np.dtype(place["type"]).newbyteorder("<"), count, place["offset"])
        arrays[name] = array.reshape(place["shape"])
    return header, arrays
