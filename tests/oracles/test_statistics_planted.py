"""Planted truths are found at the stated rates: `tests/proofs/planted_truths.py` in short."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).parents[1] / "proofs" / "planted_truths.py"


@pytest.fixture(scope="module")
def proof():
    spec = importlib.util.spec_from_file_location("planted_truths", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["planted_truths"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    yield module
    del sys.modules["planted_truths"]


@pytest.mark.parametrize(
    ("part", "campaigns"),
    [
        ("classes", 150),
        ("factors", 40),
        ("lengths", 40),
        ("rare", 40),
        ("pooled", 300),
        ("stopping", 60),
        ("comparison", 150),
    ],
)
def test_planted_truths_are_found_alone(proof, part, campaigns):
    findings = list(getattr(proof, part)(campaigns, np.random.default_rng(12)))
    assert findings
    assert [str(finding) for finding in findings if not finding.good] == []


@pytest.mark.parametrize(("part", "campaigns"), [("others", 60), ("these", 100)])
def test_gate_passes_losses_as_rarely_as_stated(part, campaigns):
    import gate

    findings = list(getattr(gate, part)(campaigns, np.random.default_rng(18)))
    assert [str(finding) for finding in findings if not finding.good] == []


def test_finding_beyond_stated_rate_is_not_good(proof):
    assert not proof.Finding("wrong", 20, 100, most=0.05).good
    assert not proof.Finding("found", 60, 100, least=0.9).good
    assert proof.Finding("wrong", 7, 100, most=0.05).good
