"""Manifests of a store with right checksums and any content, and all that reads them: for fuzzing."""

import hashlib
import json
from pathlib import Path

from vastflow.tasks.engine.engine import said
from vastflow.tasks.store.store import Lost

SOUND = {
    "execute/ab/abcd/0-2": {"runs": [[0, 1.5], [1, 2.0]]},
    "judge/ab/abcd": {"runs": [[0, "pass"], [1, "fail"]], "causes": [[1, "contact"]]},
    "rows/ab/abcd": {"counted": [["safety", "pass", 1], [None, "fail", 1]], "stood_still": 0},
    "search/ab/abcd": {"batches": 3},
    "observe/ab/abcd": {},
}
"""Key to the facts of a sound artifact of each stage whose facts are read."""


def promise_of(store, key):
    """Return the second line of a sound manifest, which is to be mutated."""
    store.put(key, {"a.bin": b"a"}, SOUND[key])
    return Path(store.place, key, "manifest").read_bytes().partition(b"\n")[2]


def read_manifest(store, key, promise):
    """Put a promise with its right checksum into a folder store and read it; return the fault.

    Nothing but `Lost` may be raised while it is read, and what is found has the facts of its stage.
    """
    manifest = Path(store.place, key, "manifest")
    if not manifest.parent.is_dir():
        promise_of(store, key)
    manifest.write_bytes(hashlib.sha256(promise).hexdigest().encode() + b"\n" + promise)
    fault, artifact = store.fault(key), store.find(key)
    if artifact is not None:
        json.dumps(artifact.info)
        assert len(artifact.content) == 64
        for name in artifact.files:
            try:
                store.load(artifact, name)
            except Lost:
                assert store.find(key) is None
        _read_facts(key.partition("/")[0], artifact)
    return fault


def _read_facts(stage, artifact):
    """Read facts as the engine, a search, and tables do."""
    info = artifact.info
    if stage == "execute":
        assert all(isinstance(s, float) for s in {int(run): float(s) for run, s in info["runs"]}.values())
    if stage == "judge":
        said(artifact)
    if stage == "rows":
        assert isinstance(info["stood_still"] + sum(count for _, _, count in info["counted"]), int)
    if stage == "search":
        int(info["batches"])
