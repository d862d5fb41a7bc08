"""Results of a benchmark, as JSON or as a table, and the loop that they are compared by."""

import json
import time
from collections.abc import Mapping
from typing import Any

import pandas as pd


def shown(found: Mapping[str, Any], *, as_json: bool) -> str:
    """One line of JSON, or a line for each value with its dotted name."""
    return json.dumps(found) if as_json else pd.json_normalize(found).iloc[0].to_string(float_format="{:.4g}".format)


def loop_s() -> float:
    """CPU time of an empty loop of Python's: what this machine is like at the moment."""
    began_s = time.process_time()
    for _ in range(5_000_000):
        pass
    return time.process_time() - began_s
